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

/// Checks the counters of a wrist, and estimates the tool's angular velocity from them. Does
/// nothing for a device without a wrist.
///
/// A jump is judged as MotionGuard judges those of the arm's joints: between two samplings at most
/// T apart, with v the joint's last speed, V and A the profile's limits and c the angle of a count,
/// counts have jumped where
///
///   |g_2 - g_1| > min(V, |v| + A T) T + kJumpFloor_counts c
///
/// MotorCheck pushes a wrist with motors alone, and only before the first force. But a tool does
/// not travel kSuspectTravel_m without any of its joints' encoders counting once: the arm turns
/// under the hand. An encoder that has not counted for so long is suspected until it does. That is
/// no fault, since forces do not depend on the orientation; the orientation is marked instead.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class WristGuard {
 public:
  /// Time constant of the angular velocity, first order: a count is some 6 mrad.
  static constexpr double kVelocityTimeConstant_s = 0.030;
  /// What rounding may add to a step.
  static constexpr double kJumpFloor_counts = 8.0;
  /// [m] of the tool's path, in steps of kTravelStep_m, so that noise of a resting arm adds
  /// nothing.
  static constexpr double kSuspectTravel_m = 1.0;
  static constexpr double kTravelStep_m = 1e-3;

  explicit WristGuard(const profiles::DeviceProfile& profile) noexcept;

  /// Takes one cycle's report and pose. @returns kImplausibleJump, kSaturatedEncoder or kNone.
  [[nodiscard]] Fault check(const driver::DeviceReport& report,
                            const driver::ArmPose& pose) noexcept;

  /// The counter at fault after a fault: 3, 4, 5 for d, e, f; else negative.
  [[nodiscard]] int encoder() const noexcept { return encoder_; }
  /// Suspected encoders: bits 0, 1, 2 for d, e, f.
  [[nodiscard]] std::uint8_t suspected() const noexcept { return suspected_; }
  /// [rad/s] of the tool's frame, filtered; zero until two reports have been seen.
  [[nodiscard]] const Eigen::Vector3d& angular_velocity_D() const noexcept {
    return angular_velocity_D_;
  }

 private:
  /// The first wrist joint that has jumped, or -1; takes the speeds in.
  int jumped(const driver::DeviceReport& report) noexcept;
  void watch_travel(const driver::DeviceReport& report, const driver::ArmPose& pose) noexcept;
  void follow(const driver::DeviceReport& report, const driver::ArmPose& pose) noexcept;

  profiles::DeviceProfile::Gimbal gimbal_;
  Eigen::Array3d max_speed_rad_per_s_;
  Eigen::Array3d max_acceleration_rad_per_s2_;
  Eigen::Array3d angle_per_count_rad_;

  bool has_last_ = false;
  int encoder_ = -1;
  std::uint8_t suspected_ = 0;
  std::uint64_t last_sequence_ = 0;
  rt::TimePoint last_sampled_{};
  rt::TimePoint last_sampled_after_{};  ///< the last counts can't be older
  std::array<std::int32_t, 6> last_counts_{};
  Eigen::Array3d joint_speed_rad_per_s_;  ///< from the last step
  Eigen::Matrix3d last_rotation_DT_ = Eigen::Matrix3d::Identity();
  Eigen::Vector3d angular_velocity_D_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d anchor_D_ = Eigen::Vector3d::Zero();  ///< [m] of the last step of the travel
  std::array<double, 3> still_for_m_{};                 ///< travel since d, e, f last counted
};

}  // namespace forcegrid::servo
