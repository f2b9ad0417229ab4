// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "driver/device.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "servo_loop/fault.h"

namespace forcegrid::servo {

/// Checks whether the device's reports are plausible, and estimates the tool's velocity from them.
///
/// A jump is judged in joint space, by the longest time that can lie between the samplings of the
/// two reports, from when the OUT of the first was handed over until the OUT of the second had
/// completed. With v the joint's last speed, V and A the profile's limits for it, and the angle c
/// of one count, counts have jumped where
///
///   |q_2 - q_1| > min(V, |v| + A T) T + kJumpFloor_counts c
///
/// A stop or a hand may slow a joint down in no time, or turn it round, but neither makes it faster
/// at once.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class MotionGuard {
 public:
  /// Time constant of the velocity estimate, first order: quantisation steps of 20 um at 1 kHz
  /// would otherwise read as 20 mm/s.
  static constexpr double kVelocityTimeConstant_s = 0.010;
  /// What rounding and a few spoilt bits may add to a step.
  static constexpr double kJumpFloor_counts = 8.0;
  /// The filtered speed may exceed the profile's limit for less than this. Counts that a stalled
  /// host or bus stamped late make one step look too fast.
  static constexpr rt::Duration kTooFastFor = std::chrono::milliseconds(20);

  /// Reports farther apart than this, or as long on their way, are too old to compute a force from.
  /// A fault if that is so for more than half of the time, by kLateBudget_s.
  static constexpr rt::Duration kLateGap = std::chrono::milliseconds(25);
  static constexpr double kLateBudget_s = 0.25;

  /// @param report_timeout no new report for this long is a fault.
  MotionGuard(const profiles::DeviceProfile& profile, rt::Duration report_timeout);

  /// Takes one cycle's report and pose. @returns the fault they show, or kNone.
  [[nodiscard]] Fault check(rt::TimePoint now, driver::DeviceHealth health,
                            const driver::DeviceReport& report,
                            const driver::ArmPose& pose) noexcept;

  /// The joint at fault after kImplausibleJump and kSaturatedEncoder: 0, 1, 2; else negative.
  int joint() const noexcept { return joint_; }

  /// [m/s] filtered; zero until two reports have been seen.
  const Eigen::Vector3d& velocity_D() const noexcept { return velocity_D_; }

 private:
  /// The first joint whose counts have jumped, if one has; takes the speeds in.
  int jumped(const driver::DeviceReport& report) noexcept;
  Fault distrusted(Fault otherwise, const driver::DeviceReport& report) noexcept;

  double max_speed_m_per_s_;
  Eigen::Array3d max_joint_speed_rad_per_s_;
  Eigen::Array3d max_joint_acceleration_rad_per_s2_;
  Eigen::Array3d angle_per_count_rad_;  ///< without the sign
  rt::Duration report_timeout_;

  bool has_last_ = false;
  int joint_ = -1;
  rt::TimePoint last_received_{};
  double late_s_ = 0.0;
  std::uint64_t last_sequence_ = 0;
  rt::TimePoint last_sampled_{};
  rt::TimePoint last_sampled_after_{};  ///< the last counts can't be older
  std::array<std::int32_t, 6> last_counts_{};
  Eigen::Array3d joint_speed_rad_per_s_;  ///< from the last step
  rt::TimePoint slow_enough_at_{};        ///< the newest report at a speed within the limit
  Eigen::Vector3d last_position_D_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_D_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::servo
