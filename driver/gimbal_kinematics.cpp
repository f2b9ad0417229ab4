// SPDX-License-Identifier: Apache-2.0
#include "driver/gimbal_kinematics.h"

#include <Eigen/Geometry>
#include <numbers>

namespace forcegrid::driver {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Vector3d;

std::array<double, 4> quaternion_wxyz(const Matrix3d& rotation) noexcept {
  const Eigen::Quaterniond q = Eigen::Quaterniond(rotation).normalized();
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  return {sign * q.w(), sign * q.x(), sign * q.y(), sign * q.z()};
}

Eigen::Array3d gimbal_angle_per_count_rad(const profiles::DeviceProfile& profile) noexcept {
  if (!profile.gimbal.present) {
    return Eigen::Array3d::Zero();
  }
  return 2.0 * std::numbers::pi / array_of(profile.gimbal.encoder_counts_per_turn);
}

GimbalKinematics::GimbalKinematics(const profiles::DeviceProfile& profile)
    : gimbal_(profile.gimbal),
      linkage_sign_(array_of(profile.kinematics.linkage_sign)),
      linkage_offset_rad_(array_of(profile.kinematics.linkage_offset_rad)) {
  if (gimbal_.present) {
    angle_per_count_rad_ = array_of(gimbal_.encoder_sign) * gimbal_angle_per_count_rad(profile);
  }
}

Vector3d GimbalKinematics::joint_angles(const std::array<std::int32_t, 6>& counts) const noexcept {
  if (!gimbal_.present) {
    return Vector3d::Zero();
  }
  Vector3d angle_rad;
  for (int i = 0; i < 3; ++i) {
    const auto counter = static_cast<std::size_t>(gimbal_.counter[static_cast<std::size_t>(i)]);
    angle_rad[i] = angle_per_count_rad_[i] * counts[counter];
  }
  return angle_rad;
}

void GimbalKinematics::orient(const std::array<std::int32_t, 6>& counts,
                              ArmPose& pose) const noexcept {
  if (!gimbal_.present || pose.status == KinematicsStatus::kNotFinite) {
    return;
  }
  const Eigen::Array3d theta = linkage_offset_rad_ + linkage_sign_ * pose.joint_angle_rad.array();
  const Matrix3d yaw = AngleAxisd(theta[0], Vector3d::UnitZ()).toRotationMatrix();
  pose.arm_axis_D.col(0) = linkage_sign_[0] * Vector3d::UnitZ();
  pose.arm_axis_D.col(1).setZero();
  pose.arm_axis_D.col(2) = -linkage_sign_[2] * yaw.col(1);

  Matrix3d rotation =
      yaw * AngleAxisd(0.5 * std::numbers::pi - theta[2], Vector3d::UnitY()).toRotationMatrix();
  pose.gimbal_angle_rad = joint_angles(counts);
  bool within_stops = true;
  for (int i = 0; i < 3; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    const int axis = gimbal_.axis[joint];
    pose.gimbal_axis_D.col(i) = rotation.col(axis);
    const double angle_rad = pose.gimbal_angle_rad[i];
    rotation = rotation * AngleAxisd(angle_rad, Vector3d::Unit(axis)).toRotationMatrix();
    within_stops = within_stops && angle_rad >= gimbal_.joint_min_rad[joint] - kStopTolerance_rad &&
                   angle_rad <= gimbal_.joint_max_rad[joint] + kStopTolerance_rad;
  }
  pose.rotation_DT = rotation;
  pose.has_orientation = true;
  if (pose.status == KinematicsStatus::kOk && !within_stops) {
    pose.status = KinematicsStatus::kOutOfRange;
  }
}

}  // namespace forcegrid::driver
