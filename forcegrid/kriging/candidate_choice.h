// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "forcegrid/core/force_method.h"
#include "forcegrid/kriging/candidate.h"
#include "forcegrid/kriging/candidate_roles.h"

namespace forcegrid::kriging {

/// The candidates of an ensemble, in the order of their names, and those with a special part in the
/// choice; null if there is none.
struct Candidates {
  std::vector<std::unique_ptr<Candidate>> all;
  static constexpr std::size_t kNone = kMaxCandidates;
  std::size_t memory = kNone;      ///< index in `all`
  std::size_t places = kNone;      ///< the same
  std::size_t walls = kNone;       ///< the same
  std::size_t unfinished = kNone;  ///< the same
  std::size_t newest = kNone;      ///< the same
  std::size_t moved = kNone;       ///< the same
  std::size_t alone = 0;           ///< the same: it begins, while the others sleep
  MemoryCandidate* memory_role = nullptr;
  RelaxationCandidate* relaxation = nullptr;
  MovedCandidate* moved_role = nullptr;

  /// Whether a candidate knows the position alone; these differ in the noise that they expect.
  bool is_general(std::size_t index) const noexcept {
    return index != memory && !(all[index]->weight() > 1.0);
  }
};

/// A sample as the candidates have evaluated it.
struct EvaluatedSample {
  static constexpr double kNotTaken_N2 = std::numeric_limits<double>::max();

  PathAtSample path;
  bool scored = true;        ///< every candidate could predict it
  bool explained = false;    ///< by one candidate alone: the others could not know
  bool first_touch = false;  ///< of the first instants of a contact
  bool surprised = false;    ///< it surprised the candidate that was rendered
  std::array<double, kMaxCandidates> error_N2{};
  std::array<double, kMaxCandidates> likelihood_nats{};  ///< of those errors, see Innovation
};

/// Scores the candidates of an ensemble and decides which of them is rendered.
///
///   score <- kept score + (1 - kept) |F_k - F(p_k)|^2       per sample k that all have evaluated
///
/// The least rating (Candidate::rate) wins, unless the rendered candidate's is nearly as good
/// (EnsembleThresholds::hysteresis) or its score below good_enough_N squared; `newest` only where
/// that is above path_wrong_N2. Of equal ratings the first wins. Candidates that know the position
/// alone also keep how likely their predictions made the samples (likely_best()).
/// Real-time: nothing allocates, locks or throws after construction. Threads: one.
class CandidateChoice {
 public:
  struct Choice {
    std::size_t candidate;
    ChoiceReason reason;
  };

  /// @param candidates, thresholds must outlive it.
  CandidateChoice(Candidates& candidates, const EnsembleThresholds& thresholds) noexcept
      : candidates_(candidates), thresholds_(thresholds) {}

  /// Adds the errors of a sample that all candidates have seen to the scores. A candidate that does
  /// not use it is assumed to err like the rendered one.
  void score(const EvaluatedSample& sample, std::size_t rendered) noexcept;
  /// The rendered candidate unless another is clearly better.
  std::size_t best(std::size_t rendered) const noexcept;
  /// The same, but of those that know the position alone and err nearly as little, the one whose
  /// predictions made the samples most likely; where errors are as good as none, the one that
  /// expects the least noise.
  std::size_t likely_best(std::size_t rendered) const noexcept;
  /// Of the candidates that know the position alone and are awake, the one that made the samples
  /// most likely, if clearly more so than `than`, or that sleeps; else `than`.
  std::size_t likeliest_general(std::size_t than) const noexcept;
  /// The best of the others that are awake and know something of their own.
  std::size_t runner_up(std::size_t rendered) const noexcept;
  /// The candidate that begins a contact: `places` if it was asked about or knows the place, else
  /// the best at first touches. Restarts the scores from the record of first touches, but for
  /// `walls` where it was wrong lately. Needs Candidates::places.
  /// @param answers_before for the expected contact; `origin_known` of the contact.
  Choice for_contact(int answers_before, bool origin_known, std::size_t rendered) noexcept;
  /// Whether `places` knows the present place, by its field as it is now, and is no worse than the
  /// best of the others; adapts its score then. Not while `moved` has found that the object is not
  /// as it was, nor if it erred more than "exact" at places that it knew. Needs Candidates::places.
  bool place_is_known(std::size_t rendered) noexcept;
  /// Whether the simulator's stiffness shows that `places`, which is rendered, does not know the
  /// place: that it would err by known_place_N at probe_m. It counts as its error then.
  bool place_is_contradicted(const Observation& observation) noexcept;
  /// Whether `memory` knows the force at `ahead_m` so much better than the rendered candidate that
  /// it takes over; adapts its score then. Needs Candidates::memory.
  bool memory_takes_over(const Eigen::Vector3d& ahead_m, std::size_t rendered) noexcept;
  /// Whether a candidate that alone explains a sample takes over at once. @param error_N2 of the
  /// rendered one.
  bool trusts(const Candidate& explaining, std::size_t rendered, double error_N2) const noexcept {
    // `moved` follows what rests by its filter, and errs less than others without any reason.
    const bool is_small = rendered == candidates_.moved &&
                          error_N2 != EvaluatedSample::kNotTaken_N2 &&
                          explaining.score_N2 < thresholds_.wall_small_share * error_N2;
    return is_small ||
           thresholds_.wall_trusted * explaining.score_N2 < candidates_.all[rendered]->score_N2;
  }
  Peers peers() const noexcept;

 private:
  void remember_refuted_walls() noexcept;
  double least_score_N2() const noexcept;
  void weigh(const EvaluatedSample& sample) noexcept;
  void score_known_place(const EvaluatedSample& sample) noexcept;
  bool is_good_enough(std::size_t index) const noexcept;
  std::size_t with_less_noise(std::size_t rendered) const noexcept;
  bool is_lucky(std::size_t index, std::size_t rendered) const noexcept;

  Candidates& candidates_;
  const EnsembleThresholds& thresholds_;
  std::uint64_t long_scored_ = 0;
  bool first_touch_scored_ = false;
  bool place_known_ = false;           ///< by its deviation, of the present contact
  double known_place_N2_ = 0.0;        ///< score of `places` at first touches of such contacts
  double known_place_exact_N2_ = 0.0;  ///< that of "exact" there
};

}  // namespace forcegrid::kriging
