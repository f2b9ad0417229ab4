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
/// Everybody but `moved` is awake for the first samples, `moved` some samples later, and not
/// where a lag looks like motion: while the simulator has not converged, and where the path
/// explained the force when all woke. Everybody is awake, later, from the moment at which the
/// rendered candidate's innovations are larger than it says (Misfit), or at which `newest` takes
/// over. All sleep once that was no use: over the last samples the rendered candidate alone would
/// have done as well as the choice between all has done, and no other one alone better. As long as
/// the path has explained the force lately, nobody sleeps for that reason.
///
/// Single candidates sleep while the others are awake if they are hopeless: over the last samples
/// their squared errors are `hopeless` times those of the rendered one, not by a few samples alone,
/// and they were not rendered lately. They wake with all others. The best of those that know the
/// position alone stays awake, to compare with.
///
/// When all sleep, these are awake alone:
///
/// - the rendered candidate, and candidates that were rendered lately, but `memory` and `places`;
///   the one that began only if it was chosen or sufficed, or beside a specialist or others. They,
///   too, sleep once that was no use, unless everybody was woken lately;
/// - `newest`, which costs nothing;
/// - `walls` and `moved` for some samples after each surprise, because walls and cuts can't wait,
///   and `walls` while it knows one;
/// - `unfinished` while the simulator says that it has not converged;
/// - `places` before a contact about which requests can be made, and at its beginning: after a win
///   at every contact, and if it wins nothing two and then four contacts apart;
/// - one candidate at a time for an audition: what innovations do not show is that another one
///   knows more. It is the one that expects the least noise where the rendered one errs by less
///   than it expects, else the last runner-up, else `memory`, and `memory` where a contact begins.
///   Auditions that nobody wins become seldom. `memory` has one, too, where the rendered candidate
///   is unsure.
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
  /// The rendered candidate can do nothing with a sample of the path: another one is needed.
  void rendered_had_no_use() noexcept;
  /// All that are awake have evaluated a sample, by which they are scored next.
  void evaluated(const EvaluatedSample& sample) noexcept;
  /// The candidates have been scored by a sample. @param choice that scored them.
  /// @returns whether candidates fell asleep.
  bool scored(const CandidateChoice& choice) noexcept;
  void handed_over(std::size_t rendered) noexcept;
  void contact_made() noexcept;
  /// The rendered candidate's largest deviation where the tool is and is going. @returns whether
  /// `memory` wakes because of it.
  bool rendered_deviates(double deviation_N) noexcept;
  /// Requests can be made for a contact that is expected: `places` says where.
  void asked_before_contact() noexcept { contact_begins_ = true; }

  bool awake(std::size_t index) const noexcept;
  /// Whether all woke so few samples ago that the choice between them changes often.
  bool undecided() const noexcept {
    return enabled_ && all_awake_ && awake_for_ < thresholds_.awake_samples;
  }
  /// The best of the candidates that know the position alone, over the samples since all woke.
  std::size_t best_general() const noexcept;
  /// Who is rendered from now on, after scored(): the one that was, unless all fell asleep.
  std::size_t stays() const noexcept { return stays_; }

  bool all_awake() const noexcept { return all_awake_; }
  /// Whether all woke again after the first samples.
  bool woken() const noexcept { return all_woken_ != 0; }
  /// Whether `places` sleeps while a contact begins whose samples it should remember.
  bool places_misses() const noexcept { return places_learn_ && !awake(candidates_.places); }
  /// The multiple of the rendered candidate's score that a woken candidate begins with.
  double first_score(std::size_t index) const noexcept {
    const bool knows_places = index == candidates_.places || index == candidates_.memory;
    return knows_places || (!all_awake_ && index == auditioned_) ? thresholds_.audition_handicap
                                                                 : 1.0;
  }

 private:
  /// Whether a candidate is asked at a contact: less and less often if it wins nothing.
  struct AskedAtContact {
    int until = 1;  ///< contacts
    int pause = 1;  ///< contacts
    bool won = false;
    bool next(int longest_pause) noexcept;
  };

  void audition() noexcept;
  std::size_t whom_to_audition() const noexcept;
  void wake_all() noexcept;
  std::size_t staying() const noexcept;
  void all_sleep(const CandidateChoice& choice) noexcept;
  bool hopeless_sleep() noexcept;
  bool dismiss_kept() noexcept;
  void restart_sums() noexcept;
  bool rendered_suffices(std::size_t stays) const noexcept;
  bool woken_lately() const noexcept;
  bool rendered_within(std::size_t index, int samples) const noexcept;
  bool kept_lately(std::size_t index) const noexcept;
  bool path_explained_lately() const noexcept;
  bool moved_is_no_cause() const noexcept;

  const Candidates& candidates_;
  const EnsembleThresholds& thresholds_;
  bool enabled_;
  Misfit misfit_;
  std::size_t rendered_ = 0;
  std::size_t stays_ = 0;
  std::uint64_t queued_ = 0;
  bool chosen_ = false;  ///< the rendered one is not just that which began
  std::array<std::uint64_t, kMaxCandidates>
      last_rendered_{};  ///< number + 1 of the sample; 0: never. Of one that knows the path: when
                         ///< the path explained the force.
  std::array<std::uint64_t, kMaxCandidates>
      dismissed_{};             ///< until then it was no use to keep it awake
  std::uint64_t unchosen_ = 0;  ///< until then the rendered one was just that which began

  bool all_awake_ = true;
  std::uint64_t all_woken_ = 0;                    ///< number + 1 of the sample; 0: never again
  bool path_explained_ = false;                    ///< the path explained the force, until then
  int awake_for_ = 0;                              ///< scored samples, of the sums below
  double chosen_N2_ = 0.0;                         ///< squared errors of what was rendered, summed
  std::array<double, kMaxCandidates> alone_N2_{};  ///< the same of each candidate

  std::array<double, kMaxCandidates> worse_{};  ///< [-1, 1] in most samples than the rendered one
  std::array<bool, kMaxCandidates> hopeless_{};

  bool contact_begins_ = false;  ///< `places` takes it
  bool places_learn_ = false;    ///< or remembers it
  bool places_asked_ = true;     ///< at this contact
  AskedAtContact ask_places_, ask_memory_;
  int unfinished_for_ = 0;         ///< samples that `unfinished` stays awake
  std::uint64_t walls_until_ = 0;  ///< number of a sample

  std::size_t runner_up_ = Candidates::kNone;
  std::size_t auditioned_ = Candidates::kNone;
  int until_audition_ = 0;  ///< samples, or those until the end of the present one
  int next_audition_ = 0;
  bool audition_at_contact_ = false;  ///< the next one
  std::uint64_t asked_until_ = 0;     ///< number of a sample: `memory` was, where one was unsure
};

}  // namespace forcegrid::kriging
