// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/arm_facts.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <numbers>

#include "driver/mechanism.h"
#include "rt/vectors.h"

namespace forcegrid::openhaptics {
namespace {

using JacobianMap = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>;

double continuous_share(const profiles::DeviceProfile& profile) {
  double share = 1.0;
  for (std::size_t i = 0; i < 3; ++i) {
    if (profile.motors.max_current_A[i] > 0.0) {
      share =
          std::min(share, profile.motors.continuous_current_A[i] / profile.motors.max_current_A[i]);
    }
  }
  return share;
}

// Right is a positive turn about an axis that points up. An axis that is level keeps its sign.
double yaw_sign(const profiles::DeviceProfile& profile) {
  std::array<std::int32_t, 6> pose{};
  std::copy(profile.calibration.pose_counts.begin(), profile.calibration.pose_counts.end(),
            pose.begin());
  constexpr double kSteep = 0.5;
  const Eigen::Vector3d axis_D =
      driver::make_mechanism(profile)->forward(pose).gimbal_axis_D.col(0);
  return axis_D.z() < -kSteep ? -1.0 : 1.0;
}

// The release number of the USB device is binary-coded decimal: 0x0123 is 1.23.
double release_number(std::uint16_t bcd) {
  return 10.0 * (bcd >> 12 & 15) + (bcd >> 8 & 15) + 0.1 * (bcd >> 4 & 15) + 0.01 * (bcd & 15);
}

}  // namespace

std::array<double, 9> rotation_hd(const std::array<double, 4>& orientation_DT_wxyz) noexcept {
  const auto& [w, x, y, z] = orientation_DT_wxyz;
  // The quaternion's vector part changes frames as any vector does.
  const std::array<double, 3> vector_HD = to_hd({x, y, z});
  const Eigen::Matrix3d rotation =
      Eigen::Quaterniond(w, vector_HD[0], vector_HD[1], vector_HD[2]).toRotationMatrix();
  std::array<double, 9> rows{};
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data()) = rotation;
  return rows;
}

ArmFacts facts_of(const session::DeviceSession& session, const DeviceEntry& entry) {
  const profiles::DeviceProfile& profile = session.profile();
  ArmFacts facts;
  facts.model = entry.model.empty() ? profile.name.substr(0, 254) : entry.model;
  facts.vendor = session.manufacturer().empty() ? "Forcegrid" : session.manufacturer();
  facts.serial = session.serial();
  facts.firmware_version = release_number(profile.usb.device_release);
  facts.origin_mm = entry.origin_mm;
  const auto low = to_hd(profile.limits.workspace_min_m);
  const auto high = to_hd(profile.limits.workspace_max_m);
  for (std::size_t i = 0; i < 3; ++i) {
    facts.workspace_mm[i] = kMm_per_m * low[i] - entry.origin_mm[i];
    facts.workspace_mm[i + 3] = kMm_per_m * high[i] - entry.origin_mm[i];
  }
  facts.tabletop_mm = is_delta(profile)
                          ? facts.workspace_mm[1]
                          : -kMm_per_m * profile.kinematics.origin_m[2] - entry.origin_mm[1];
  facts.max_stiffness_N_per_mm = profile.limits.max_stiffness_N_per_m / kMm_per_m;
  facts.max_damping_N_s_per_mm = profile.limits.max_damping_N_s_per_m / kMm_per_m;
  facts.max_force_N = profile.limits.max_force_N;
  facts.continuous_force_N = facts.max_force_N * continuous_share(profile);
  facts.has_wrist = has_wrist(profile);
  if (facts.has_wrist) {
    facts.gimbal_sign = {yaw_sign(profile), 1.0, -1.0};
  }
  facts.has_wrist_motors = profile.gimbal_motors.present;
  facts.max_torque_mNm = kMm_per_m * profile.gimbal_motors.max_torque_Nm;
  facts.has_joints = !is_delta(profile);
  if (facts.has_joints) {
    const auto& sign = profile.kinematics.linkage_sign;
    const auto& offset_rad = profile.kinematics.linkage_offset_rad;
    facts.joint_sign = {-sign[0], -sign[1], sign[2]};
    facts.joint_offset_rad = {-offset_rad[0], std::numbers::pi / 2 - offset_rad[1], offset_rad[2]};
  }
  return facts;
}

std::array<double, 3> joint_torque_mNm(const ArmFacts& facts, const session::ToolState& state,
                                       const std::array<double, 3>& force_D_N) noexcept {
  const Eigen::Vector3d torque_Nm =
      JacobianMap(state.jacobian_D_m_per_rad.data()).transpose() * rt::to_vector(force_D_N);
  std::array<double, 3> result{};
  for (std::size_t i = 0; i < 3; ++i) {
    result[i] = kMm_per_m * facts.joint_sign[i] * torque_Nm[static_cast<Eigen::Index>(i)];
  }
  return result;
}

std::array<double, 3> force_of_joint_torque_D(const ArmFacts& facts,
                                              const session::ToolState& state,
                                              const std::array<double, 3>& torque_mNm) noexcept {
  if (!facts.has_joints) {
    return {};
  }
  Eigen::Vector3d torque_Nm;
  for (std::size_t i = 0; i < 3; ++i) {
    torque_Nm[static_cast<Eigen::Index>(i)] = facts.joint_sign[i] * torque_mNm[i] / kMm_per_m;
  }
  const Eigen::Matrix3d jacobian = JacobianMap(state.jacobian_D_m_per_rad.data());
  return rt::to_array(jacobian.transpose().inverse() * torque_Nm);
}

}  // namespace forcegrid::openhaptics
