// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Geometry of the emulated arm's wrist: three joints in series between the last link and the tool,
/// whose axes meet in the tip. Written from the device sheet alone, as ArmKinematics is.
///
///   g_i = s_i 2 pi n_i / cpr_i
///   R   = R_z(theta_a) R_y(pi/2 - theta_c) R_1(g_1) R_2(g_2) R_3(g_3)     tool frame to D
///
/// with theta of ArmKinematics. No motor drives it and it has no mass: the hand turns it.
/// Real-time: no allocation, lock or throw. Threads: const, no hidden state.
/// Source: haptikfabrikenapi `src/kinematics.cpp` (rotation), the device profile (numbers).
class Wrist {
 public:
  explicit Wrist(const profiles::DeviceProfile::Gimbal& gimbal) noexcept : gimbal_(gimbal) {}

  [[nodiscard]] bool present() const noexcept { return gimbal_.present; }
  /// [rad] `angle_rad` within the hard stops.
  [[nodiscard]] Eigen::Vector3d within_stops(const Eigen::Vector3d& angle_rad) const noexcept;
  /// [rad] g at the counters d, e, f of a device's six; zero without a wrist.
  [[nodiscard]] Eigen::Vector3d joint_angle_rad(
      const std::array<std::int32_t, 6>& counts) const noexcept;
  /// [counts] The encoders' positions d, e, f at joint angles [rad]; rounded.
  [[nodiscard]] std::array<std::int64_t, 3> encoder_positions(
      const Eigen::Vector3d& angle_rad) const noexcept;
  /// The tool's frame in D: columns are its axes.
  /// @param linkage_angle_rad theta of the arm. @param angle_rad g; ignored without a wrist, where
  ///        the tool keeps the axes of D.
  [[nodiscard]] Eigen::Matrix3d tool_axes_D(const Eigen::Vector3d& linkage_angle_rad,
                                            const Eigen::Vector3d& angle_rad) const noexcept;

  /// The joints' axes in D at the same angles: columns 1, 2, 3.
  [[nodiscard]] Eigen::Matrix3d joint_axes_D(const Eigen::Vector3d& linkage_angle_rad,
                                             const Eigen::Vector3d& angle_rad) const noexcept;

 private:
  profiles::DeviceProfile::Gimbal gimbal_;
};

}  // namespace forcegrid::emulator
