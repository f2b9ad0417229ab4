// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>

#include "compat/openhaptics/device_table.h"
#include "device_session/device_session.h"

namespace forcegrid::openhaptics {

inline constexpr double kMm_per_m = 1000.0;

/// HD's frame: x to the user's right, y up, z toward the user. D: x toward the user, y to the
/// user's right, z up. Real-time, both.
constexpr std::array<double, 3> to_hd(const std::array<double, 3>& vector_D) noexcept {
  return {vector_D[1], vector_D[2], vector_D[0]};
}
constexpr std::array<double, 3> to_device(const std::array<double, 3>& vector_HD) noexcept {
  return {vector_HD[2], vector_HD[0], vector_HD[1]};
}

/// HD's rotation, row by row, of a tool whose frame is turned by the unit quaternion w, x, y, z in
/// D. The axes of HD's end effector are those of HD's frame where the tool's are those of D.
/// Real-time.
std::array<double, 9> rotation_hd(const std::array<double, 4>& orientation_DT_wxyz) noexcept;

/// HD's gimbal angles [rad] of the wrist's joints from the arm outward: right, down and clockwise
/// (seen by the user) are positive. @param sign  ArmFacts::gimbal_sign. Real-time.
constexpr std::array<double, 3> gimbal_angles_hd(const std::array<double, 3>& gimbal_rad,
                                                 const std::array<double, 3>& sign) noexcept {
  return {sign[0] * gimbal_rad[0], sign[1] * gimbal_rad[1], sign[2] * gimbal_rad[2]};
}

/// What does not change about an open device, in HD's units.
struct ArmFacts {
  std::string model;
  std::string vendor;
  std::string serial;
  double firmware_version = 0.0;
  std::array<double, 3> origin_mm{};     ///< see DeviceEntry
  std::array<double, 6> workspace_mm{};  ///< xmin ymin zmin xmax ymax zmax
  double tabletop_mm = 0.0;              ///< y of the table
  double max_stiffness_N_per_mm = 0.0;
  double max_damping_N_s_per_mm = 0.0;
  double max_force_N = 0.0;
  double continuous_force_N = 0.0;
  bool has_joints = false;                   ///< of a serial arm; a parallel one answers zeros
  std::array<double, 3> joint_sign{};        ///< d(HD angle)/dq, +1 or -1
  std::array<double, 3> joint_offset_rad{};  ///< HD angle at q = 0
  bool has_wrist = false;                    ///< else the orientation is the identity
  std::array<double, 3> gimbal_sign{};       ///< d(HD angle)/dg of the wrist's joints, +1 or -1
  bool has_wrist_motors = false;             ///< torques are exerted
  double max_torque_mNm = 0.0;               ///< at the tool; 0 without motors in the wrist
};

/// HD's joint angles are the turret's to the left, the thigh's above the horizontal, and the
/// shin's from straight down toward the user:
///   [0] = -theta_a,  [1] = pi/2 - theta_b,  [2] = theta_c     (theta: driver/kinematics.h)
/// Its gimbal angles are those of the wrist's joints; the first one's sign is turned where its axis
/// points down in the calibration pose, so that right is positive there, too.
/// The continuous force is the largest one times the smallest ratio of a motor's continuous to its
/// largest current. The table is where the arm's base stands.
ArmFacts facts_of(const session::DeviceSession& session, const DeviceEntry& entry);

/// [mN m] J^T F of HD's joints; zero without joints. Real-time.
std::array<double, 3> joint_torque_mNm(const ArmFacts& facts, const session::ToolState& state,
                                       const std::array<double, 3>& force_D_N) noexcept;

/// [N] The force at the tool that HD's joint torques give; NaN in a singular pose, zero without
/// joints. Real-time.
std::array<double, 3> force_of_joint_torque_D(const ArmFacts& facts,
                                              const session::ToolState& state,
                                              const std::array<double, 3>& torque_mNm) noexcept;

}  // namespace forcegrid::openhaptics
