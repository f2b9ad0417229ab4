// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "driver/device.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "servo_loop/fault.h"

namespace forcegrid::servo {

/// Checks whether the device's reports are plausible, and estimates the tool's velocity from them.
/// Real-time: no allocation, lock or throw. Threads: one.
class MotionGuard {
 public:
  /// Time constant of the velocity estimate, first order: quantisation steps of 20 um at 1 kHz
  /// would otherwise read as 20 mm/s.
  static constexpr double kVelocityTimeConstant_s = 0.010;
  /// Between two reports the tool may move this many times as fast as the profile's largest speed,
  /// plus kJumpFloor_m. Beyond that the encoders have jumped.
  static constexpr double kJumpFactor = 3.0;
  static constexpr double kJumpFloor_m = 0.002;
  /// The filtered speed may exceed the profile's limit for less than this. Counts that a stalled
  /// host or bus stamped late make one step look too fast.
  static constexpr rt::Duration kTooFastFor = std::chrono::milliseconds(20);

  /// Reports farther apart than this are too old to compute a force from. A fault if that is so for
  /// more than half of the time, by kLateBudget_s.
  static constexpr rt::Duration kLateGap = std::chrono::milliseconds(25);
  static constexpr double kLateBudget_s = 0.25;

  /// @param report_timeout no new report for this long is a fault.
  MotionGuard(const profiles::DeviceProfile& profile, rt::Duration report_timeout);

  /// Takes one cycle's report and pose. @returns the fault they show, or kNone.
  [[nodiscard]] Fault check(rt::TimePoint now, driver::DeviceHealth health,
                            const driver::DeviceReport& report,
                            const driver::ArmPose& pose) noexcept;

  /// The joint at fault after kSaturatedEncoder: 0, 1, 2; else negative.
  int joint() const noexcept { return joint_; }

  /// [m/s] filtered; zero until two reports have been seen.
  const Eigen::Vector3d& velocity_D() const noexcept { return velocity_D_; }

 private:
  double max_speed_m_per_s_;
  rt::Duration report_timeout_;
  Fault distrusted(Fault otherwise, const driver::DeviceReport& report) noexcept;

  bool has_last_ = false;
  int joint_ = -1;
  rt::TimePoint last_received_{};
  double late_s_ = 0.0;
  std::uint64_t last_sequence_ = 0;
  rt::TimePoint last_sampled_{};
  rt::TimePoint sampled_before_last_{};  ///< the last counts can't be older than these
  rt::TimePoint slow_enough_at_{};       ///< the newest report at a speed within the limit
  Eigen::Vector3d last_position_D_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_D_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::servo
