// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "forcegrid/core/force_method.h"

namespace forcegrid {
#pragma GCC visibility push(default)

/// Holds back forces that are implausible as an object's answer until the next sample confirms
/// them.
///
/// From one sample to the next the force follows the tool: with (P0, F0) the last believed sample,
/// S the stiffness observed along the path (Broyden's rank-one estimate) and k the largest recent
/// |dF| / |dP|, the force at P is expected at E = F0 + S (P - P0). A force is believed at once if
///
///   min over 0 <= c <= 1 of |F - c E|  <=  kSlack_N + k |P - P0|:
///
/// because such a force either follows on or only gives way, like an object that is cut or slips. A
/// force that resists the step is believed as well, like a wall that the tool has met within it,
/// with u = (F - E) / |F - E|:
///
///   |F - E|  <=  kSlack_N + kMostStiffness_N_per_m max(0, -u . (P - P0)),
///
/// unless a sample was refused in the last kWary samples. Every other force surprises, and the next
/// sample decides. If that sample follows on from the last believed one, the surprise was an
/// outlier and is refused. If it confirms the surprise, both are believed, one sample late: the
/// object has snapped. Two samples confirm each other if they are no further apart than the
/// surprise is large, and
///
///   |F1 - F2| <= kSlack_N + kMostStiffness_N_per_m |P1 - P2|   and   |F1|, |F2| <= max_force_N
///
/// (the latter unless they resist): no arm can render a stiffer object, and this arm no larger
/// force. So a simulator whose forces are wrong by a large factor is refused for as long as they
/// are; its last good sample ages, and the servo fades the force out.
///
/// Failure: outliers within the slack; two that agree by chance; a contact's first force, which has
/// nothing to be compared with; a rigid object, whose force would be zero instead of a vibration.
/// Source for Broyden: Math. Comp. 19 (1965), 577. Real-time: yes. Threads: one.
class SampleGate {
 public:
  static constexpr double kSlack_N = 0.3;
  /// A Phantom Premium's own frame has 3.5 kN/m.
  static constexpr double kMostStiffness_N_per_m = 4000.0;
  static constexpr int kWary = 300;  ///< ten seconds of a usual simulator

  /// @param max_force_N of the device; forces may grow beyond it, but not jump beyond it.
  explicit SampleGate(double max_force_N = std::numeric_limits<double>::infinity()) noexcept
      : max_force_N_(max_force_N) {}

  /// The samples that the method may take after `sample` has arrived, oldest first: none, the
  /// sample, or the previous one and the sample. Valid until the next call. Samples that are not
  /// finite pass: the method counts them.
  std::span<const Sample> pass(const Sample& sample) noexcept;
  /// Contact was made or lost: earlier samples no longer predict the next.
  void forget() noexcept;
  /// Samples that were refused, from construction on.
  std::uint64_t refused() const noexcept { return refused_; }

 private:
  bool follows(const Sample& sample) const noexcept;
  bool resists(const Sample& sample) const noexcept;
  bool bears_out(const Sample& sample) const noexcept;
  double allowed_N(const Eigen::Vector3d& step_m) const noexcept;
  Eigen::Vector3d expected_N(const Eigen::Vector3d& step_m) const noexcept;
  void believe(const Sample& sample) noexcept;
  void refuse_held() noexcept;

  double max_force_N_;
  int believed_ = 0;  ///< samples since forget(), no more than kLearning of them counted
  Eigen::Vector3d position_m_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_N_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d slope_N_per_m_ = Eigen::Matrix3d::Zero();
  double steepest_N_per_m_ = 0.0;
  bool holds_ = false;
  int wary_ = 0;                  ///< samples for which a surprise is not believed at once
  std::array<Sample, 2> passed_;  ///< the first is the one held
  std::uint64_t refused_ = 0;
};

#pragma GCC visibility pop
}  // namespace forcegrid
