// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/driven_wrist.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace forcegrid::emulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Vector3d rotation_vector_rad(const Matrix3d& rotation) noexcept {
  const Eigen::AngleAxisd turned(rotation);
  return turned.angle() * turned.axis();
}

}  // namespace

DrivenWrist::DrivenWrist(const profiles::DeviceProfile& profile, const Vector3d& angle_rad)
    : geometry_(profile.gimbal),
      motors_(profile.gimbal_motors),
      angle_rad_(angle_rad),
      target_rad_(angle_rad) {}

void DrivenWrist::advance(double duration_s, const Vector3d& motor_torque_Nm,
                          const Vector3d& target_rad, const Vector3d& linkage_angle_rad) noexcept {
  if (!(duration_s > 0.0)) {
    return;
  }
  const int steps = std::max(1, static_cast<int>(std::ceil(duration_s / kSubstep_s - 1e-9)));
  const double step_s = duration_s / steps;
  const Vector3d from_rad = target_rad_;
  const Vector3d target_speed_rad_per_s = (target_rad - from_rad) / duration_s;
  for (int i = 1; i <= steps; ++i) {
    target_rad_ = from_rad + i * step_s * target_speed_rad_per_s;
    substep(step_s, motor_torque_Nm, target_rad_, target_speed_rad_per_s, linkage_angle_rad);
  }
}

void DrivenWrist::substep(double step_s, const Vector3d& motor_torque_Nm,
                          const Vector3d& target_rad, const Vector3d& target_speed_rad_per_s,
                          const Vector3d& linkage_angle_rad) noexcept {
  const Matrix3d tool_D = geometry_.tool_axes_D(linkage_angle_rad, angle_rad_);
  const Matrix3d axes_D = geometry_.joint_axes_D(linkage_angle_rad, angle_rad_);
  hand_torque_D_.setZero();
  Matrix3d resistance = Matrix3d::Identity() *
                        (motors_.joint_inertia_kg_m2 / step_s + motors_.joint_damping_Nm_s_per_rad);
  if (held_) {
    const Matrix3d wanted_D = geometry_.tool_axes_D(linkage_angle_rad, target_rad);
    const Vector3d hand_speed_D =
        geometry_.joint_axes_D(linkage_angle_rad, target_rad) * target_speed_rad_per_s;
    hand_torque_D_ =
        motors_.hand_stiffness_Nm_per_rad * rotation_vector_rad(wanted_D * tool_D.transpose()) -
        motors_.hand_damping_Nm_s_per_rad * (axes_D * speed_rad_per_s_ - hand_speed_D);
    // The hand's share in the implicit step, so that a stiff hand stays stable.
    resistance += (motors_.hand_damping_Nm_s_per_rad + step_s * motors_.hand_stiffness_Nm_per_rad) *
                  axes_D.transpose() * axes_D;
  }
  const Vector3d torque_Nm = motor_torque_Nm + axes_D.transpose() * hand_torque_D_ -
                             motors_.joint_damping_Nm_s_per_rad * speed_rad_per_s_;
  speed_rad_per_s_ += resistance.inverse() * torque_Nm;
  const Vector3d free_rad = angle_rad_ + step_s * speed_rad_per_s_;
  angle_rad_ = geometry_.within_stops(free_rad);
  for (int joint = 0; joint < 3; ++joint) {
    if (angle_rad_[joint] != free_rad[joint]) {
      speed_rad_per_s_[joint] = 0.0;  // a stop takes all of it
    }
  }
}

Vector3d DrivenWrist::arm_torque_Nm(const Vector3d& linkage_angle_rad,
                                    const Vector3d& linkage_sign) const noexcept {
  // The base turns the tool about z, the last link by -theta_c about the yawed y.
  const Vector3d yawed_y(-std::sin(linkage_angle_rad[0]), std::cos(linkage_angle_rad[0]), 0.0);
  return linkage_sign.cwiseProduct(Vector3d(hand_torque_D_.z(), 0.0, -yawed_y.dot(hand_torque_D_)));
}

}  // namespace forcegrid::emulator
