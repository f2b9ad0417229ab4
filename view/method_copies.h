// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "forcegrid/core/storage_blocks.h"
#include "servo_loop/first_touch.h"
#include "servo_loop/sample_intake.h"
#include "servo_loop/servo_ports.h"
#include "view_link/feed_messages.h"

namespace forcegrid::view {

/// The view's own copies of a run's force methods. They get the same samples in the same cycles as
/// the servo's, so that they have the same field, which the servo never has to share.
///
/// A method's result depends only on the order of its calls (ForceMethod), so that a copy's force
/// is the servo's to the last bit, as long as no cycle and no sample is missing. A gap makes the
/// copies begin anew: exact() is false from then on.
/// Real-time: no. Threads: one.
class MethodCopies {
 public:
  struct Options {
    std::vector<std::string> methods;  ///< as `run` names them; the first one is rendered
    MethodOptions base;                ///< that each got before its own
    int fill_budget = 1000;
    double requests_per_s = 0.0;
    double max_force_N = 0.0;
    double simulator_rate_Hz = 30.0;
  };

  /// Cycles that may wait for a sample that has not come yet.
  static constexpr std::size_t kMostWaiting = 4000;
  /// Larger differences between a copy's force and the servo's are none of rounding.
  static constexpr double kRounding_N = 1e-6;

  /// Method `direct`, which is a simulator, has no copy, and neither has one over two tools: its
  /// force is unknown everywhere.
  /// @throws std::invalid_argument for a method or an option that can't be used.
  explicit MethodCopies(Options options);

  /// Forgets everything: what comes next is the first, or as if a page had joined there.
  void restart();
  void take(const view_link::FeedSample& sample);
  void take(const view_link::FeedCycle& cycle);

  std::size_t size() const noexcept { return copies_.size(); }
  /// Whether the copies have seen all that the servo's methods have, and answer as those did. A
  /// recording rounds its times, so that its copies may differ in the last digits.
  bool exact() const noexcept { return exact_ && largest_difference_N_ <= kRounding_N; }
  /// Largest difference [N] between a copy's force and the servo's, at the tool, so far.
  double largest_difference_N() const noexcept { return largest_difference_N_; }

  /// What method `index` would answer at `position_W` [m] now, which is the newest cycle's time.
  ForceEstimate force(std::size_t index, const Eigen::Vector3d& position_W) const;
  /// As StorageBlocks::storage_blocks() of method `index`; 0 for one without.
  std::size_t storage_blocks(std::size_t index, std::span<StorageBlock> blocks) const;

 private:
  void begin_anew();
  void take_settings(const view_link::FeedCycle& cycle);
  void replay(const view_link::FeedCycle& cycle);

  Options options_;
  std::vector<std::unique_ptr<ForceMethod>> copies_;  // in the loop's order
  std::vector<ForceMethod*> methods_;
  std::unique_ptr<servo::ServoPorts> ports_;
  std::unique_ptr<servo::SampleIntake> intake_;
  servo::FirstTouch first_touch_;
  std::deque<servo::ArrivedSample> samples_;  // that no cycle has taken yet
  std::deque<view_link::FeedCycle> cycles_;   // that wait for samples
  std::uint64_t arrivals_ = 0;                // samples that have come
  std::uint64_t taken_ = 0;                   // of these by cycles
  std::uint64_t next_cycle_ = 0;
  bool begun_ = false;
  bool exact_ = true;
  double time_s_ = 0.0;
  double budget_reads_ = 0.0;  // that the methods were told last; NaN: none
  double largest_difference_N_ = 0.0;
};

}  // namespace forcegrid::view
