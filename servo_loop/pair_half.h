// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/pair_force_method.h"
#include "servo_loop/pair_exchange.h"

namespace forcegrid::servo {

/// One tool's half of a force method over two tools, as a ForceMethod of that tool's servo loop.
///
/// Each loop has a PairForceMethod of its own, and both hear the same samples. This half renders
///
///   F = h H + (1 - h) [ w F_both(P_own, P_other) + (1 - w) F_alone(P_own) ]
///
///   F_both   this tool's force of the pair method, with the other tool where it is now: its newest
///            place, moved on by its velocity for the age of that place
///   F_alone  of a method of one tool, which always runs beside it
///   w        rises to 1 within kRise_s while F_both can be rendered, else falls within kFade_s
///   H, h     the last force before F_both was lost at once; h falls from 1 to 0 within kHandOver_s
///
/// The velocity is that at the end of the last two cycles (end_velocity()). What it moves on for a
/// cycle is off by two counts of the encoders more; one that lags behind costs stability.
///
/// F_both can be rendered while both tools hold the object, the other one's place is at most kOld_s
/// old, and the pair method knows a force there. An older place is moved on for kMostAhead_s and
/// then kept until w is 0, so no position older than kOld_s + kFade_s is used. F_both is lost at
/// once when either tool's contact changes, since the pair method then forgets. When this tool
/// comes off the object the force is zero at once, as of every method.
///
/// Two samples are one PairSample if they are of one solution (Sample::solution), belong to the
/// contacts that last, and their tools were there at most kTogether_s apart. What has found no
/// partner among the last kPending samples of the other tool is left to F_alone. The pair has a
/// stiffness if each of the two has its own and the influence of the other tool where that one's
/// sample is, within kSamePlace_m: all four blocks are of one solution then.
///
/// Requests: none. Candidates: the pair method and the method alone, so that records tell which of
/// them is rendered (w >= 1/2), with ChoiceReason kBothTools or kOneTool. Uncertainty: of F_alone
/// while it alone is rendered, else unknown.
///
/// Failure: a simulator that does not tell which samples are of one solution gives no pairs; a
/// third tool on the object looks like a change of it.
/// Real-time: as ForceMethod. Threads: one, the loop's; the other half has the other loop's.
class PairHalf final : public ForceMethod {
 public:
  static constexpr double kOld_s = 0.010;
  static constexpr double kMostAhead_s = 0.005;
  static constexpr double kRise_s = 0.1;
  static constexpr double kFade_s = 0.03;
  static constexpr double kHandOver_s = 0.05;
  static constexpr double kTogether_s = 0.020;
  static constexpr double kShortest_s = 1e-4;  ///< cycle that tells a velocity
  static constexpr double kSamePlace_m = 1e-9;
  static constexpr std::size_t kPending = 8;
  /// Indices in candidates().
  static constexpr std::uint8_t kBoth = 0;
  static constexpr std::uint8_t kAlone = 1;

  /// @param both, alone  not null. @param exchange  shared with the other half; outlives both.
  /// @param tool  0 or 1, the other half's is the other one: which tool of `both` is this one.
  PairHalf(std::unique_ptr<PairForceMethod> both, std::unique_ptr<ForceMethod> alone,
           PairExchange& exchange, std::size_t tool);

  const char* name() const noexcept override { return both_->name(); }
  std::size_t memory_bytes() const noexcept override;
  void take_sample(const Sample& sample) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  /// Half of the budget is for each of the two methods.
  int work(int budget) noexcept override;
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  void expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;
  std::span<const char* const> candidates() const noexcept override { return names_; }

  /// Cycles with this tool on the object, each counted once: `cycles_both_tools` rendered over both
  /// (w >= 1/2); `cycles_other_off` the other tool does not hold the object, `cycles_other_late`
  /// its place is too old, `cycles_learning` both are known but not yet the force. Then
  /// `returns_to_one_tool`: how often w fell below 1/2 while this tool held on; `samples_paired`,
  /// `samples_unpaired`: of this tool while both hold on; `samples_untold`: that the other loop did
  /// not fetch in time; `samples_with_stiffness`: of those paired. Then the pair method's own
  /// counters.
  std::span<const NamedCounter> counters() const noexcept override {
    return std::span(counters_).first(counter_count_);
  }

 private:
  enum Counted : std::uint8_t {
    kCyclesBoth,
    kCyclesOtherOff,
    kCyclesOtherLate,
    kCyclesLearning,
    kReturns,
    kPaired,
    kUnpaired,
    kUntold,
    kWithStiffness,
    kOwnCounters
  };
  static constexpr std::size_t kMostCounters = 16;

  /// The last samples of one tool that have no partner yet.
  struct Pending {
    std::array<Sample, kPending> samples{};
    std::array<bool, kPending> waits{};
    std::size_t next = 0;

    /// @returns whether the oldest had to go, which still waited.
    bool add(const Sample& sample) noexcept;
    void clear() noexcept { waits.fill(false); }
  };

  std::uint64_t& count(Counted what) noexcept { return counters_[what].value; }
  PairVector both(const Eigen::Vector3d& own, const Eigen::Vector3d& other) const noexcept;
  Eigen::Vector3d own(const PairVector& of_both) const noexcept;
  PairMatrix stiffness_W(const Sample& mine, const Sample& theirs) const noexcept;
  PairVector positions_W(double time_s, const Eigen::Vector3d& position_W) const noexcept;
  ForceEstimate mixed(ForceEstimate estimate, const PairEstimate& of_both) const noexcept;
  void tell_place(double time_s, const Eigen::Vector3d& position_W) noexcept;
  void keep_force() noexcept;
  void take_news() noexcept;
  void renew_contacts(const Eigen::Vector3d& position_W) noexcept;
  void match() noexcept;
  void take_pair(const Sample& mine, const Sample& theirs) noexcept;
  void move_weights(double time_s, double elapsed_s, const Eigen::Vector3d& position_W) noexcept;

  std::unique_ptr<PairForceMethod> both_;
  std::unique_ptr<ForceMethod> alone_;
  PairExchange& exchange_;
  std::size_t tool_;
  std::array<const char*, 2> names_;

  bool observed_ = false;
  double time_s_ = 0.0;  ///< of the newest observe(), as what follows
  Eigen::Vector3d position_W_ = Eigen::Vector3d::Zero();
  double elapsed_s_ = 0.0;  ///< of the last cycle that told a velocity; 0: none yet
  Eigen::Vector3d mean_velocity_W_m_per_s_ = Eigen::Vector3d::Zero();  ///< in it
  Eigen::Vector3d velocity_W_m_per_s_ = Eigen::Vector3d::Zero();       ///< at its end

  bool in_contact_ = false;
  std::uint32_t epoch_ = 0;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  bool other_known_ = false;
  PairPlace other_;

  bool both_hold_ = false;  ///< as the pair method knows it, in these two epochs
  std::uint32_t own_epoch_of_both_ = 0;
  std::uint32_t other_epoch_of_both_ = 0;
  std::uint32_t pair_epoch_ = 0;

  Pending mine_;
  Pending theirs_;
  bool unmatched_news_ = false;

  Eigen::Vector3d rendered_W_ = Eigen::Vector3d::Zero();  ///< while w > 0, by the last observe()
  double weight_ = 0.0;                                   ///< w
  bool rendered_both_ = false;                            ///< w >= 1/2 in the last cycle
  double held_share_ = 0.0;                               ///< h
  Eigen::Vector3d held_W_ = Eigen::Vector3d::Zero();      ///< H

  std::array<NamedCounter, kMostCounters> counters_{};
  std::size_t counter_count_ = 0;
};

}  // namespace forcegrid::servo
