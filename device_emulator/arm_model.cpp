// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/arm_model.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace forcegrid::emulator {

using Eigen::Matrix3d;
using Eigen::Vector3d;

ArmModel::ArmModel(const profiles::DeviceProfile& profile,
                   const std::optional<profiles::HandProfile>& hand,
                   const Vector3d& joint_angle_rad, bool hand_carries_weight)
    : HeldMechanism(profile.dynamics, hand, hand_carries_weight,
                    profile.gravity.acceleration_m_per_s2),
      kinematics_(profile.kinematics),
      links_weigh_(!profile.gravity.balanced),
      gravity_b_Nm_(profile.gravity.acceleration_m_per_s2 *
                    (profile.gravity.link_b_mass_kg * profile.gravity.link_b_center_m +
                     profile.gravity.link_c_mass_kg * profile.kinematics.link_length_m[1])),
      gravity_c_Nm_(profile.gravity.acceleration_m_per_s2 * profile.gravity.link_c_mass_kg *
                    profile.gravity.link_c_center_m),
      joint_min_rad_(profile.kinematics.joint_min_rad.data()),
      joint_max_rad_(profile.kinematics.joint_max_rad.data()),
      elbow_min_rad_(profile.kinematics.elbow_min_rad),
      elbow_max_rad_(profile.kinematics.elbow_max_rad),
      joint_angle_rad_(joint_angle_rad) {
  place_hand_target(position_D());
}

Vector3d ArmModel::gravity_torque_Nm(const ArmKinematics::Motion& motion) const noexcept {
  if (hand_carries_weight_) {
    return Vector3d::Zero();
  }
  Vector3d torque_Nm = -tip_weight_N_ * motion.jacobian_m_per_rad.row(2).transpose();
  if (links_weigh_) {
    torque_Nm += kinematics_.linkage_sign().cwiseProduct(
        Vector3d(0.0, gravity_b_Nm_ * std::sin(motion.linkage_angle_rad[1]),
                 -gravity_c_Nm_ * std::sin(motion.linkage_angle_rad[2])));
  }
  return torque_Nm;
}

double ArmModel::kinetic_energy_J() const noexcept {
  const auto motion = kinematics_.motion(joint_angle_rad_, joint_speed_rad_per_s_);
  return 0.5 * moving_mass_kg_ *
             (motion.jacobian_m_per_rad * joint_speed_rad_per_s_).squaredNorm() +
         0.5 * dynamics_.joint_inertia_kg_m2 * joint_speed_rad_per_s_.squaredNorm();
}

HeldMechanism::Stops ArmModel::stops_at(const Vector3d& joint_angle_rad,
                                        const Vector3d& joint_speed_rad_per_s) const noexcept {
  Stops stops;
  const auto touch = [&](const Vector3d& axis, double excess_rad) {
    stops.touch(axis, excess_rad, axis.dot(joint_speed_rad_per_s),
                dynamics_.stop_stiffness_Nm_per_rad, dynamics_.stop_damping_Nm_s_per_rad);
  };
  for (int joint = 0; joint < 3; ++joint) {
    const Vector3d axis = Vector3d::Unit(joint);
    if (joint_angle_rad[joint] > joint_max_rad_[joint]) {
      touch(axis, joint_angle_rad[joint] - joint_max_rad_[joint]);
    } else if (joint_angle_rad[joint] < joint_min_rad_[joint]) {
      touch(-axis, joint_min_rad_[joint] - joint_angle_rad[joint]);
    }
  }
  const Vector3d elbow_axis(0.0, kinematics_.linkage_sign()[1], kinematics_.linkage_sign()[2]);
  const double elbow_rad = kinematics_.elbow_rad(joint_angle_rad);
  if (elbow_rad > elbow_max_rad_) {
    touch(elbow_axis, elbow_rad - elbow_max_rad_);
  } else if (elbow_rad < elbow_min_rad_) {
    touch(-elbow_axis, elbow_min_rad_ - elbow_rad);
  }
  return stops;
}

void ArmModel::substep(const Drive& drive) noexcept {
  const double step_s = drive.step_s;
  const Vector3d speed = joint_speed_rad_per_s_;
  const Vector3d angle_mid = joint_angle_rad_ + 0.5 * step_s * speed;
  const auto at_mid = kinematics_.motion(angle_mid, speed);
  const Matrix3d& jacobian = at_mid.jacobian_m_per_rad;
  const Matrix3d jacobian_squared = jacobian.transpose() * jacobian;

  // Forces at the predicted midpoint with the initial speed; `resistance`, the implicit part, holds
  // what the change of speed adds.
  const Vector3d hand_N = hand_force_D(drive, at_mid.position_D, jacobian * speed);
  const Vector3d gravity_Nm = gravity_torque_Nm(at_mid);
  const Stops stops = stops_at(angle_mid, speed);
  Vector3d stop_Nm = Vector3d::Zero();
  stops.add_force(stop_Nm);
  const Vector3d applied_Nm =
      drive.motor_torque_Nm + gravity_Nm + stop_Nm + jacobian.transpose() * hand_N;

  Matrix3d inertia = moving_mass_kg_ * jacobian_squared;
  inertia.diagonal().array() += dynamics_.joint_inertia_kg_m2;
  Matrix3d resistance = inertia + mass_with_hand_kg(0.0, step_s) * jacobian_squared;
  stops.add_resistance(step_s, resistance);

  // Two passes: the second one has the speeds at the middle and the end of the substep.
  Vector3d change = Vector3d::Zero();
  Vector3d friction = Vector3d::Zero();
  for (int pass = 0; pass < 2; ++pass) {
    friction = friction_Nm_s_per_rad(speed + change);
    const Vector3d bias_D = pass == 0
                                ? at_mid.bias_m_per_s2
                                : kinematics_.motion(angle_mid, speed + 0.5 * change).bias_m_per_s2;
    Matrix3d system = resistance;
    system.diagonal() += step_s * friction;
    change = system.llt().solve(step_s * (applied_Nm - friction.cwiseProduct(speed) -
                                          moving_mass_kg_ * jacobian.transpose() * bias_D));
  }

  const Vector3d speed_mid = speed + 0.5 * change;
  const Vector3d turned = step_s * speed_mid;
  joint_speed_rad_per_s_ = speed + change;
  joint_angle_rad_ += turned;

  account_for_motors(drive.motor_torque_Nm.dot(turned));
  const Vector3d hand_mid_N = hand_N - hand_resistance_N_s_per_m(step_s) * (jacobian * change);
  work_.hand_J += hand_mid_N.dot(jacobian * turned);
  work_.friction_J -= friction.cwiseProduct(joint_speed_rad_per_s_).dot(turned);
  work_.gravity_J += gravity_Nm.dot(turned);
  stops.add_work(step_s, change, turned, work_.stops_J);
}

}  // namespace forcegrid::emulator
