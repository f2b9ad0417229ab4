// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// Unit quaternion (w, x, y, z) of a rotation, the one of the two with w >= 0.
/// @param rotation  orthonormal, right-handed.
/// Real-time: no allocation, lock or throw. Threads: any.
std::array<double, 4> quaternion_wxyz(const Eigen::Matrix3d& rotation) noexcept;

/// Orientation of the tool on an arm with a wrist: three joints between the last link and the tool,
/// each about an axis of the frame that the joints before have left.
///
///   g_i  = s_i 2 pi n_i / cpr_i                             joint angle of its counter
///   R_DT = R_z(theta_a) R_y(pi/2 - theta_c) R_1(g_1) R_2(g_2) R_3(g_3)
///
/// The tool's frame T is parallel to D where the last link points toward the user and g = 0; x of
/// T without the wrist is the last link's direction. Its angular velocity, in D, is
///
///   w_D = sum over a, b, c of arm_axis_D q_i' + sum over the wrist of gimbal_axis_D g_i'
///
/// with arm_axis_D = (sign_a z, 0, -sign_c R_z(theta_a) y). The elbow's drive keeps theta_c
/// absolute, so joint b does not turn the tool. Source: haptikfabrikenapi src/kinematics.cpp
/// (rotation), by way of the device sheet's section 6; axes derived. Real-time: every const
/// function is bounded and neither allocates, locks nor throws. Threads: const functions from any
/// thread.
class GimbalKinematics {
 public:
  /// [rad] Hard stops give: a wrist is out of range only this far beyond them.
  static constexpr double kStopTolerance_rad = 0.05;

  /// @param profile  of an arm; one without a wrist leaves every pose as it is.
  explicit GimbalKinematics(const profiles::DeviceProfile& profile);

  /// [rad] g_1, g_2, g_3 of a report's counters; zero without a wrist.
  [[nodiscard]] Eigen::Vector3d joint_angles(
      const std::array<std::int32_t, 6>& counts) const noexcept;

  /// Adds the tool's orientation and the axes to `pose`, which is that of the same counters. A pose
  /// that is not finite stays so; a wrist beyond its stops makes one that was kOk kOutOfRange.
  void orient(const std::array<std::int32_t, 6>& counts, ArmPose& pose) const noexcept;

 private:
  profiles::DeviceProfile::Gimbal gimbal_;
  Eigen::Array3d angle_per_count_rad_ = Eigen::Array3d::Zero();  ///< signed
  Eigen::Array3d linkage_sign_;
  Eigen::Array3d linkage_offset_rad_;
};

/// [rad] The angle of one count of the wrist's joints, without its sign; zero without a wrist.
Eigen::Array3d gimbal_angle_per_count_rad(const profiles::DeviceProfile& profile) noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::driver
