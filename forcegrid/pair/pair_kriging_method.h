// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "forcegrid/core/pair_force_method.h"
#include "forcegrid/pair/pair_field.h"

namespace forcegrid {

/// Kriging over the positions of two tools (pair::PairField), by one field or by the best of a few:
///
///   kriging-6d   one field
///   auto-6d      fields that differ in the noise that they expect of a sample, and in whether its
///                stiffness is data; the one whose predictions of the last samples were best is
///                rendered
///
/// A candidate's score is the running mean of its squared errors |F - prediction|^2 of the samples
/// before it took them, a newer sample counting kNewest. Another candidate takes over when its
/// score is below kBetter of the rendered one's; the force then moves to its own within some
/// kFade_s.
///
/// Beside fields without it, those with stiffness as data sleep until a sample of the contact has
/// one. If that is the first, they are rendered first, since the others know nothing of the slope
/// yet. The rule above chooses among those with and those without. Between the best of both decides
/// the running mean of log(e_with^2 / e_without^2), which counts each sample alike, as the errors
/// fall by orders of magnitude in the first second: below log(kBetter) those with stiffness take
/// over unless their score is worse, above -log(kBetter) those without. The first of them, if the
/// force has changed by more than kChanged_N, is compared with an error kFirstBetter times smaller.
///
/// Contacts: everything learnt is forgotten at contacts_made(), since what the tools hold is
/// another patch. forces(): zero and kUnknown before the first sample and beyond kUnknown_m of
/// every one in R^6; between kFade_m and kUnknown_m the force fades to zero and is kPartlyKnown.
///
/// Work: a sample costs a few pieces for each field (PairField::prepare()), each counted as half
/// the square of the field's rows. Until all are done the answers do not change. Failure: kinks;
/// forces that depend on more than both positions, such as viscosity. Cost, memory and accuracy:
/// docs/two_tools.md. Real-time: as PairForceMethod.
class PairKrigingMethod final : public PairForceMethod {
 public:
  /// @param name static text. @param candidates usable settings, one or more; the first is
  /// rendered first. Those with stiffness_samples come last.
  PairKrigingMethod(const char* name, std::span<const pair::PairFieldSettings> candidates);

  const char* name() const noexcept override { return name_; }
  std::size_t memory_bytes() const noexcept override;
  void take_sample(const PairSample& sample) noexcept override;
  void contacts_made(std::uint32_t epoch, const PairVector& points_W) noexcept override;
  void contacts_lost() noexcept override;
  int work(int budget) noexcept override;
  void observe(double time_s, const PairVector& positions_W) noexcept override;
  [[nodiscard]] PairEstimate forces(double time_s,
                                    const PairVector& positions_W) const noexcept override;
  /// `samples_passed_over`: samples that came while kQueue others still waited.
  /// `changes_of_candidate`: how often another one took over.
  std::span<const NamedCounter> counters() const noexcept override { return counters_; }

  const pair::PairField& rendered() const noexcept { return fields_[rendered_]; }

  static constexpr std::size_t kQueue = 8;
  static constexpr double kNewest = 0.15;
  static constexpr double kBetter = 0.7;
  static constexpr double kLeastError_N = 1e-4;  ///< in comparisons: less is as good as none
  /// A right stiffness explains the first change of force but for 1 / kFirstBetter of it, if it is
  /// above kChanged_N.
  static constexpr double kFirstBetter = 6.0;
  static constexpr double kChanged_N = 0.1;
  static constexpr double kFade_s = 0.010;  ///< time constant of a change of candidate
  static constexpr double kFade_m = 0.060;
  static constexpr double kUnknown_m = 0.090;

 private:
  struct Queued {
    PairVector positions_m;
    PairVector forces_N;
    bool has_stiffness;
    PairMatrix stiffness_N_per_m;
  };

  bool takes_stiffness(std::size_t field) const noexcept {
    return fields_[field].settings().stiffness_samples > 0;
  }
  bool awake(std::size_t field) const noexcept {
    return field < plain_count_ || plain_count_ == 0 || stiffness_seen_;
  }
  void see_stiffness() noexcept;
  void prefer_better(std::size_t first, std::size_t end, std::size_t& preferred) const noexcept;
  void choose() noexcept;
  int piece() noexcept;
  void finish_sample() noexcept;
  void hand_over() noexcept;
  void render_first() noexcept;
  PairVector fading_N(double time_s) const noexcept;

  const char* name_;
  std::vector<pair::PairField> fields_;  ///< those without stiffness as data first
  std::size_t plain_count_ = 0;          ///< of these
  bool stiffness_seen_ = false;          ///< in this contact
  bool any_taken_ = false;               ///< likewise
  std::vector<double> scores_N2_;        ///< of each; negative: no prediction yet
  std::size_t plain_ = 0;                ///< preferred of the fields without stiffness
  std::size_t stiff_ = 0;                ///< and of those with it
  int compared_ = 0;                     ///< samples in log_ratio_
  /// Running mean, of the best field with stiffness and the best one without: the logarithm of how
  /// their squared errors compare.
  double log_ratio_ = 0.0;
  std::size_t rendered_ = 0;
  std::size_t chosen_ = 0;  ///< to be rendered as soon as it can be read

  std::array<Queued, kQueue> queue_{};
  std::uint64_t queued_ = 0;  ///< samples ever queued
  std::uint64_t next_ = 0;    ///< the one that the fields take next
  bool taking_ = false;
  double newest_s_ = -1e300;

  bool known_ = false;  ///< a contact has been made or lost
  bool in_contact_ = false;
  PairVector points_W_ = PairVector::Zero();

  double now_s_ = 0.0;
  PairVector now_m_ = PairVector::Zero();
  double changed_s_ = 0.0;
  PairVector left_N_ = PairVector::Zero();  ///< of the candidate before, at changed_s_
  std::array<NamedCounter, 2> counters_{{{"samples_passed_over", 0}, {"changes_of_candidate", 0}}};
};

}  // namespace forcegrid
