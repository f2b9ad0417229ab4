// SPDX-License-Identifier: Apache-2.0
#include "calibration/rigid_body.h"

namespace forcegrid::calibration {

RigidBody::RigidBody(const profiles::DeviceProfile& profile, double known_mass_kg)
    : profile_(profile),
      mechanism_(driver::make_mechanism(profile)),
      links_weigh_(profile.kind == profiles::DeviceKind::kArm && !profile.gravity.balanced),
      known_mass_kg_(known_mass_kg),
      moving_mass_kg_(profile.dynamics.tip_mass_kg + known_mass_kg),
      joint_inertia_kg_m2_(profile.dynamics.joint_inertia_kg_m2),
      gravity_m_per_s2_(profile.kind == profiles::DeviceKind::kDelta
                            ? profiles::kStandardGravity_m_per_s2
                            : profile.gravity.acceleration_m_per_s2) {}

driver::ArmPose RigidBody::pose(const std::array<std::int32_t, 6>& counts) noexcept {
  std::array<std::int32_t, 6> corrected = counts;
  for (std::size_t joint = 0; joint < 3; ++joint) {
    corrected[joint] += offset_counts_[joint];
  }
  return mechanism_->forward(corrected);
}

Eigen::Vector3d RigidBody::holding_Nm(const driver::ArmPose& pose) const noexcept {
  Eigen::Vector3d torque_Nm =
      known_mass_kg_ * gravity_m_per_s2_ * pose.jacobian_D.row(2).transpose();
  if (links_weigh_) {
    torque_Nm += mechanism_->gravity_torque(pose.joint_angle_rad);
  }
  return torque_Nm;
}

Eigen::Vector3d RigidBody::inertial_Nm(
    const driver::ArmPose& pose, const Eigen::Vector3d& tip_acceleration_D_m_per_s2,
    const Eigen::Vector3d& joint_acceleration_rad_per_s2) const noexcept {
  return moving_mass_kg_ * pose.jacobian_D.transpose() * tip_acceleration_D_m_per_s2 +
         joint_inertia_kg_m2_ * joint_acceleration_rad_per_s2;
}

Eigen::Vector3d RigidBody::joint_inertia_kg_m2(const driver::ArmPose& pose) const noexcept {
  Eigen::Vector3d inertia_kg_m2;
  for (Eigen::Index joint = 0; joint < 3; ++joint) {
    inertia_kg_m2[joint] =
        moving_mass_kg_ * pose.jacobian_D.col(joint).squaredNorm() + joint_inertia_kg_m2_;
  }
  return inertia_kg_m2;
}

}  // namespace forcegrid::calibration
