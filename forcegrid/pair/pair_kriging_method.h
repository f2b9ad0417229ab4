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
///   auto-6d      fields that differ in the noise that they expect of a sample; the one whose
///                predictions of the last samples were best is rendered
///
/// A candidate's score is the running mean of its squared errors |F - prediction|^2 of the samples
/// before it took them, a newer sample counting kNewest. Another candidate takes over when its
/// score is below kBetter of the rendered one's; the force then moves to its own within some
/// kFade_s.
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
  /// rendered first.
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
  static constexpr double kFade_s = 0.010;  ///< time constant of a change of candidate
  static constexpr double kFade_m = 0.060;
  static constexpr double kUnknown_m = 0.090;

 private:
  struct Queued {
    PairVector positions_m;
    PairVector forces_N;
  };

  int piece() noexcept;
  void finish_sample() noexcept;
  void hand_over() noexcept;
  void render_first() noexcept;
  PairVector fading_N(double time_s) const noexcept;

  const char* name_;
  std::vector<pair::PairField> fields_;
  std::vector<double> scores_N2_;  ///< of each; negative: no prediction yet
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
