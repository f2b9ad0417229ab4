// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "forcegrid/kriging/candidate_choice.h"
#include "forcegrid/kriging/contact_state.h"
#include "forcegrid/kriging/ensemble_candidates.h"
#include "forcegrid/kriging/ensemble_thresholds.h"
#include "forcegrid/kriging/field_rendering.h"
#include "forcegrid/kriging/field_requests.h"
#include "forcegrid/kriging/hand_over_fade.h"
#include "forcegrid/kriging/history.h"
#include "forcegrid/kriging/sample_queue.h"
#include "forcegrid/kriging/store_follower.h"
#include "forcegrid/kriging/tool_motion.h"
#include "forcegrid/kriging/wake_rule.h"
#include "forcegrid/kriging/work_budget.h"

namespace forcegrid {

/// An ensemble of kriging fields, the candidates, which evaluate the same samples; the candidate
/// whose recent predictions were best is rendered. In `auto`, candidates that nothing speaks for
/// sleep (kriging::WakeRule): on a plain elastic object one is awake most of the time.
///
/// - `kriging-bank`: nine candidates for noise, kinks, objects that remember, and one-sided
///   constraints. Needs: force.
/// - `auto`: without the two of these that gain nothing beside the others, and with six more, for
///   places touched long ago, for a simulator that has not converged, for relaxation, for places of
///   first touch, and for objects that change all the time or are moved or weakened. Needs: force;
///   contact point and requests before contact if available.
///
/// kriging::make_candidates() makes the candidates. kriging::CandidateChoice scores them and
/// decides when another takes over; kriging::Candidate, what a role changes in that;
/// kriging::EnsembleThresholds holds the thresholds. A hand-over never makes a step in the force
/// (kriging::HandOverFade).
///
/// Work: a sample costs each candidate one piece, a change of some rows of its factor and its
/// weights. The rendered candidate takes it first, then `walls`, then the one furthest behind. A
/// piece is done in one call of work() and counts as half the square of the field's rows, so a
/// piece never makes a cycle longer than one fit does. A candidate that is too far behind skips
/// samples, see counters(). A woken candidate begins, in one piece, with up to kBeginsWith queued
/// samples, and takes the last kScoredAtOnce of them as the others did, so that it has a score.
///
/// Within MethodOptions::budget_reads, `auto` has as many samples and candidates as that pays for
/// (kriging::plan_for), and work waits until the mean cost allows it (kriging::WorkBudget).
///
/// Contacts, force() and requests: as KrigingMethod, for the rendered candidate. Before an expected
/// contact `places` makes the requests.
/// Options used: spacing_m, spacing_N and, by `auto`, budget_reads.
/// Cost, memory, accuracy and tuning: docs/kriging.md. Real-time: as ForceMethod.
class EnsembleMethod final : public ForceMethod {
 public:
  using Kind = kriging::EnsembleKind;

  /// @param options spacings, which must be usable: make_force_method() checks.
  explicit EnsembleMethod(Kind kind, const MethodOptions& options,
                          const kriging::EnsembleThresholds& thresholds = {});
  EnsembleMethod(const EnsembleMethod&) = delete;  // the parts refer to each other
  EnsembleMethod& operator=(const EnsembleMethod&) = delete;

  const char* name() const noexcept override;
  MethodNeeds needs() const noexcept override;
  std::size_t memory_bytes() const noexcept override;
  /// As KrigingMethod::take_sample().
  void take_sample(const Sample& sample) noexcept override;
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  void expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept override;
  int work(int budget) noexcept override;
  bool plan_request(double time_s, const Eigen::Vector3d& position_W,
                    Eigen::Vector3d& wanted_W) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;
  /// Of `auto`: fields and candidates are those that the options paid for, whatever is set later.
  std::optional<double> least_budget_reads() const noexcept override { return least_budget_reads_; }
  void set_budget(double reads_per_cycle) noexcept override {
    if (least_budget_reads_) {
      budget_.set(reads_per_cycle);
    }
  }
  std::span<const char* const> candidates() const noexcept override {
    return {names_.data(), candidates_.all.size()};
  }
  /// `samples_passed_over`: samples that a candidate never took because it was
  /// kriging::SampleQueue::kLongestBacklog samples behind; one per candidate and sample.
  /// With a budget also `samples_over_budget`: those that the rendered candidate never took because
  /// the budget had not paid for the one before when the next came; and `cycles_over_budget`: those
  /// in which work waited for the budget.
  std::span<const NamedCounter> counters() const noexcept override {
    return {counters_.data(), budget_.limited() ? counters_.size() : 1};
  }
  std::uint64_t samples_passed_over() const noexcept { return counters_[kPassedOver].value; }

  /// Index in candidates().
  std::size_t rendered() const noexcept { return rendered_; }
  const kriging::Candidate& candidate(std::size_t index) const noexcept {
    return *candidates_.all[index];
  }
  /// False if there was not enough memory for the store; the method then must not be used.
  bool allocated() const noexcept {
    return candidates_.memory_role == nullptr || candidates_.memory_role->store().allocated();
  }

 private:
  static constexpr std::size_t kBeginsWith = 40;
  static constexpr std::uint64_t kScoredAtOnce = 6;
  /// [cycles] What is shown waits for samples, but not for all of the next one's.
  static constexpr int kUncertaintyWaits = 16;
  /// Samples that a woken candidate takes one by one if its field can't begin with many.
  static constexpr std::uint64_t kTakesAtOnce = 24;
  static constexpr std::uint64_t kLongestCatchUp = 48;
  /// While no candidate that knows them is awake, the paths of tool and force are followed by one
  /// point in this time; a little less than 4 and 16 ms, so that servo periods vary as they may.
  static constexpr double kPathAsleep_s = 0.0035;
  static constexpr double kForceAsleep_s = 0.0155;
  static_assert(kBeginsWith + kTakesAtOnce <= kriging::SampleQueue::kLength);

  using Candidate = kriging::Candidate;
  using EvaluatedSample = kriging::EvaluatedSample;

  enum Counter : std::size_t { kPassedOver, kSamplesOverBudget, kCyclesOverBudget, kCounters };

  Candidate& rendered_candidate() noexcept { return *candidates_.all[rendered_]; }
  const Candidate& rendered_candidate() const noexcept { return *candidates_.all[rendered_]; }
  bool asks_before_contact() const noexcept {
    return candidates_.places != kriging::Candidates::kNone;
  }
  EvaluatedSample& evaluated(std::uint64_t number) noexcept {
    return evaluated_[number % kriging::SampleQueue::kLength];
  }
  void enter_contact(const Eigen::Vector3d& point_W) noexcept;
  void pass_over_backlog() noexcept;
  void look_up_path(const Sample& sample, kriging::PathAtSample& path) const noexcept;
  void observe_path() noexcept;
  void observe_rendered_force() noexcept;
  void follow_noise() noexcept;
  void follow_wake_rule() noexcept;
  void wake(std::size_t index) noexcept;
  int begin(std::size_t index) noexcept;
  bool is_paid_for(std::size_t next) const noexcept;
  bool all_ready() const noexcept;
  int do_piece(std::size_t next, int budget) noexcept;
  bool has_missed(std::size_t index) const noexcept;
  int remember() noexcept;
  std::size_t next_to_serve() const noexcept;
  int take_next(std::size_t index) noexcept;
  void taken(std::size_t index, std::uint64_t number,
             const kriging::Innovation& innovation) noexcept;
  void take_rendered(const Candidate& candidate, std::uint64_t number, bool follows) noexcept;
  std::uint64_t evaluated_by_all() const noexcept;
  void score() noexcept;
  void hand_over(std::size_t index, ChoiceReason reason) noexcept;
  int prepare(std::size_t index, int budget) noexcept;
  void decide_on_place() noexcept;
  bool may_follow() const noexcept;
  int follow() noexcept;
  void update_uncertainty() noexcept;
  std::size_t requests_planner() const noexcept;
  double deviation_N(const Candidate& candidate, const Eigen::Vector3d& position_W) const noexcept;
  Eigen::Vector3d force_N(const Candidate& candidate) const noexcept;
  /// Where the tool was last observed or, without observations, last sampled.
  const Eigen::Vector3d& tool_W() const noexcept {
    return motion_.observed() ? motion_.position_W() : queue_.newest_W();
  }

  Kind kind_;
  kriging::EnsembleThresholds thresholds_;
  ToolHistory path_;  ///< of the tool
  kriging::Candidates candidates_;
  bool knows_path_ = false;  ///< a candidate does
  bool path_awake_ = true;   ///< such a candidate is awake
  std::array<const char*, kMaxCandidates> names_{};
  kriging::CandidateChoice choice_;
  std::size_t rendered_ = 0;
  std::size_t noise_as_ = 0;  ///< `moved` expects the noise of this candidate
  ChoiceReason reason_ = ChoiceReason::kFirst;
  kriging::HandOverFade fade_;

  double path_observed_s_ = -1e300;
  double force_observed_s_ = -1e300;
  kriging::ToolMotion motion_;
  kriging::ContactState contact_;
  int answers_before_ = 0;        ///< for the expected contact
  bool place_undecided_ = false;  ///< a contact has begun, and `places` is not ready
  kriging::SampleQueue queue_;
  std::array<EvaluatedSample, kriging::SampleQueue::kLength> evaluated_{};
  std::uint64_t scored_ = 0;           ///< samples whose errors are in the scores
  std::uint64_t scored_again_at_ = 0;  ///< queue_.taken() when the last were scored once more
  std::uint64_t claimed_at_ = 0;       ///< number of the sample that one alone explained, last
  kriging::WakeRule wake_rule_;
  std::array<std::uint64_t, kMaxCandidates> level_at_{};  ///< a woken one catches up until there
  std::array<bool, kMaxCandidates> begins_{};             ///< woken, and not begun yet
  std::array<kriging::Observation, kBeginsWith> recent_{};
  bool idle_ = false;             ///< nothing was left to do, and nothing has come since
  bool uncertainty_due_ = false;  ///< of the rendered candidate, which has changed
  int uncertainty_waits_ = 0;     ///< cycles
  std::optional<double> least_budget_reads_;  ///< nothing: it keeps none
  kriging::WorkBudget budget_;
  std::array<NamedCounter, kCounters> counters_{
      {{"samples_passed_over", 0}, {"samples_over_budget", 0}, {"cycles_over_budget", 0}}};
  kriging::StoreFollower follower_;
  kriging::FieldRequests requests_;
  kriging::FieldRendering rendering_;
};

}  // namespace forcegrid
