// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Geometry of the emulated arm: a base yaw and two links in a vertical plane whose second angle is
/// absolute (parallelogram drive). Written from the device sheets alone, so that a fault in the
/// driver's kinematics cannot hide in it.
///
///   q_i     = s_i (2 pi n_i / cpr_i) (d_i / D_i)          joint angle [rad] from counts n
///   theta_i = linkage_offset_i + linkage_sign_i q_i
///             (theta_a: yaw, theta_b: from the vertical, theta_c: from straight down)
///   r = L_b sin(theta_b) + L_c sin(theta_c)
///   x = r cos(theta_a) - o_x
///   y = r sin(theta_a) - o_y
///   z = L_a + L_b cos(theta_b) - L_c cos(theta_c) - o_z
///
/// Frame D: x toward the user, y to the user's right, z up; metres, radians.
/// Real-time: no allocation, lock or throw. Threads: const, no hidden state.
/// Source: haptikfabrikenapi `src/kinematics.cpp` (formulae), the device profile (numbers).
class ArmKinematics {
 public:
  /// Everything the dynamics need at one state, from one set of sines.
  struct Motion {
    Eigen::Vector3d position_D;          ///< [m] tip
    Eigen::Matrix3d jacobian_m_per_rad;  ///< J = dx/dq, D over joints
    Eigen::Vector3d bias_m_per_s2;       ///< dJ/dt q', the acceleration left when q'' = 0
    Eigen::Vector3d linkage_angle_rad;   ///< theta
  };

  explicit ArmKinematics(const profiles::DeviceProfile::Kinematics& kinematics) noexcept;

  /// [rad] q at the (not necessarily whole) encoder counts of joints a, b, c.
  [[nodiscard]] Eigen::Vector3d joint_angle_rad(const Eigen::Vector3d& counts) const noexcept;
  /// [counts] unrounded; the inverse of joint_angle_rad.
  [[nodiscard]] Eigen::Vector3d counts(const Eigen::Vector3d& joint_angle_rad) const noexcept;
  /// [m] tip position in D.
  [[nodiscard]] Eigen::Vector3d position_D(const Eigen::Vector3d& joint_angle_rad) const noexcept;
  /// All of Motion at joint angles [rad] and joint speeds [rad/s].
  [[nodiscard]] Motion motion(const Eigen::Vector3d& joint_angle_rad,
                              const Eigen::Vector3d& joint_speed_rad_per_s) const noexcept;
  /// [rad] theta_b + theta_c, the angle between the links: 0 folded, pi stretched.
  [[nodiscard]] double elbow_rad(const Eigen::Vector3d& joint_angle_rad) const noexcept;
  /// d(theta)/dq of each joint: +1 or -1.
  [[nodiscard]] const Eigen::Vector3d& linkage_sign() const noexcept { return linkage_sign_; }

 private:
  Eigen::Vector3d link_length_m_;
  Eigen::Vector3d origin_D_;
  Eigen::Vector3d joint_rad_per_count_;  // with the encoder's sign
  Eigen::Vector3d linkage_sign_;
  Eigen::Vector3d linkage_offset_rad_;
};

}  // namespace forcegrid::emulator
