// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "forcegrid/kriging/candidate_choice.h"
#include "forcegrid/kriging/ensemble_thresholds.h"
#include "forcegrid/kriging/misfit.h"
#include "forcegrid/kriging/sample_queue.h"

namespace forcegrid::kriging {

/// Which candidates of `auto` are awake. The others take no samples and cost nothing.
///
/// Everybody is awake for the first samples and, later, from the moment at which the rendered
/// candidate's innovations are larger than it says (Misfit), until no other candidate has taken
/// over for a while. Everybody stays awake as long as a specialist has been rendered lately. When
/// all sleep, these wake alone:
///
/// - the rendered candidate, and candidates that were rendered lately, but `memory` and `places`;
/// - `walls` for some samples after each surprise, because walls can't wait, and while it knows
/// one;
/// - `unfinished` while the simulator says that it has not converged;
/// - `places` before a contact and at its beginning;
/// - one candidate at a time for an audition: what innovations do not show is that another one
/// knows
///   more. It is the last runner-up, else `memory`. Auditions that nobody wins become seldom.
///
/// docs/kriging.md, "Who is awake". Real-time: nothing allocates, locks or throws. Threads: one.
class WakeRule {
 public:
  /// @param candidates, thresholds must outlive it. @param enabled false: everybody stays awake.
  WakeRule(const Candidates& candidates, const EnsembleThresholds& thresholds,
           bool enabled) noexcept;

  /// A sample has been queued. @param since_contact_s time since the contact began.
  void sample_queued(std::uint64_t number, const QueuedSample& sample, double since_contact_s,
                     std::size_t rendered) noexcept;
  /// The rendered candidate has taken a sample of the path.
  void rendered_took(const Innovation& innovation) noexcept;
  /// The candidates have been scored by a sample. @param choice that scored them.
  void scored(const CandidateChoice& choice) noexcept;
  void handed_over(std::size_t rendered) noexcept;
  void contact_made() noexcept;

  bool awake(std::size_t index) const noexcept;
  bool all_awake() const noexcept { return all_awake_; }
  /// The multiple of the rendered candidate's score that a woken candidate begins with.
  double first_score(std::size_t index) const noexcept {
    return !all_awake_ && index == auditioned_ ? thresholds_.audition_handicap : 1.0;
  }

 private:
  void audition() noexcept;
  void all_sleep(const CandidateChoice& choice) noexcept;
  bool rendered_lately(std::size_t index) const noexcept;
  bool specialist_lately() const noexcept;

  const Candidates& candidates_;
  const EnsembleThresholds& thresholds_;
  bool enabled_;
  Misfit misfit_;
  std::size_t rendered_ = 0;
  std::uint64_t queued_ = 0;
  std::array<std::uint64_t, kMaxCandidates>
      last_rendered_{};  ///< number + 1 of the sample; 0: never

  bool all_awake_ = true;
  bool changed_ = false;  ///< since all woke
  int scored_ = 0;        ///< samples
  int since_change_ = 0;  ///< scored samples, while all are awake
  int patience_ = 0;      ///< samples until a misfit wakes everybody again
  int next_patience_ = 0;

  bool contact_begins_ = false;
  int unfinished_for_ = 0;         ///< samples that `unfinished` stays awake
  std::uint64_t walls_until_ = 0;  ///< number of a sample

  std::size_t runner_up_ = Candidates::kNone;
  std::size_t auditioned_ = Candidates::kNone;
  int until_audition_ = 0;  ///< samples, or those until the end of the present one
  int next_audition_ = 0;
};

}  // namespace forcegrid::kriging
