#include "device_emulator/arm_model.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

namespace forcegrid::emulator {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// One stop in contact: torque -stiffness * excess - damping * rate along `axis`.
struct Contact {
  Vector3d axis = Vector3d::Zero();  // d(excess)/dq
  double excess_rad = 0.0;
  double rate_rad_per_s = 0.0;
};

}  // namespace

ArmModel::ArmModel(const profiles::DeviceProfile& profile,
                   std::optional<profiles::HandProfile> hand, const Vector3d& joint_angle_rad,
                   bool hand_carries_weight)
    : kinematics_(profile.kinematics),
      dynamics_(profile.dynamics),
      links_weigh_(!profile.gravity.balanced),
      hand_carries_weight_(hand.has_value() && hand_carries_weight),
      gravity_b_Nm_(profile.gravity.acceleration_m_per_s2 *
                    (profile.gravity.link_b_mass_kg * profile.gravity.link_b_center_m +
                     profile.gravity.link_c_mass_kg * profile.kinematics.link_length_m[1])),
      gravity_c_Nm_(profile.gravity.acceleration_m_per_s2 * profile.gravity.link_c_mass_kg *
                    profile.gravity.link_c_center_m),
      joint_min_rad_(profile.kinematics.joint_min_rad.data()),
      joint_max_rad_(profile.kinematics.joint_max_rad.data()),
      elbow_min_rad_(profile.kinematics.elbow_min_rad),
      elbow_max_rad_(profile.kinematics.elbow_max_rad),
      moving_mass_kg_(profile.dynamics.tip_mass_kg),
      acceleration_m_per_s2_(profile.gravity.acceleration_m_per_s2),
      joint_angle_rad_(joint_angle_rad) {
  if (hand) {
    hand_mass_kg_ = hand->mass_kg;
    moving_mass_kg_ += hand_mass_kg_;
    hand_stiffness_N_per_m_ = hand->stiffness_N_per_m;
    hand_damping_N_s_per_m_ = hand->damping_N_s_per_m;
  }
  hand_target_D_ = position_D();
}

void ArmModel::attach_tip_mass(double mass_kg) noexcept {
  moving_mass_kg_ += mass_kg;
  tip_weight_N_ += mass_kg * acceleration_m_per_s2_;
}

void ArmModel::release_hand() noexcept {
  moving_mass_kg_ -= hand_mass_kg_;
  hand_mass_kg_ = hand_stiffness_N_per_m_ = hand_damping_N_s_per_m_ = 0.0;
  hand_carries_weight_ = false;
}

void ArmModel::advance(double duration_s, const Vector3d& motor_torque_Nm,
                       const Vector3d& hand_target_D) noexcept {
  if (!(duration_s > 0.0)) {
    return;
  }
  const double substeps = std::ceil(duration_s / kSubstep_s - 1e-9);
  const double step_s = duration_s / substeps;
  const Vector3d target_start_D = hand_target_D_;
  const Vector3d target_speed_D = (hand_target_D - target_start_D) / duration_s;
  for (double i = 0.0; i < substeps; i += 1.0) {
    substep(step_s, motor_torque_Nm, target_start_D + (i + 0.5) * step_s * target_speed_D,
            target_speed_D);
  }
  hand_target_D_ = hand_target_D;
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

void ArmModel::substep(double step_s, const Vector3d& motor_torque_Nm, const Vector3d& target_mid_D,
                       const Vector3d& target_speed_D) noexcept {
  const Vector3d speed = joint_speed_rad_per_s_;
  const Vector3d angle_mid = joint_angle_rad_ + 0.5 * step_s * speed;
  const auto at_mid = kinematics_.motion(angle_mid, speed);
  const Matrix3d& jacobian = at_mid.jacobian_m_per_rad;
  const Matrix3d jacobian_squared = jacobian.transpose() * jacobian;

  // Forces at the predicted midpoint with the speed of the start; what the change of speed adds
  // is in `resistance`, the implicit part.
  const Vector3d hand_force_D = hand_stiffness_N_per_m_ * (target_mid_D - at_mid.position_D) +
                                hand_damping_N_s_per_m_ * (target_speed_D - jacobian * speed);
  const Vector3d gravity_Nm = gravity_torque_Nm(at_mid);

  std::array<Contact, 4> contacts;
  std::size_t contact_count = 0;
  Vector3d stop_Nm = Vector3d::Zero();
  const auto touch = [&](const Vector3d& axis, double excess_rad) {
    const double rate = axis.dot(speed);
    if (excess_rad > 0.0 && dynamics_.stop_stiffness_Nm_per_rad * excess_rad +
                                    dynamics_.stop_damping_Nm_s_per_rad * rate >
                                0.0) {
      contacts[contact_count++] = {axis, excess_rad, rate};
      stop_Nm -= axis * (dynamics_.stop_stiffness_Nm_per_rad * excess_rad +
                         dynamics_.stop_damping_Nm_s_per_rad * rate);
    }
  };
  for (int joint = 0; joint < 3; ++joint) {
    const Vector3d axis = Vector3d::Unit(joint);
    if (angle_mid[joint] > joint_max_rad_[joint]) {
      touch(axis, angle_mid[joint] - joint_max_rad_[joint]);
    } else if (angle_mid[joint] < joint_min_rad_[joint]) {
      touch(-axis, joint_min_rad_[joint] - angle_mid[joint]);
    }
  }
  const Vector3d elbow_axis(0.0, kinematics_.linkage_sign()[1], kinematics_.linkage_sign()[2]);
  const double elbow_rad = kinematics_.elbow_rad(angle_mid);
  if (elbow_rad > elbow_max_rad_) {
    touch(elbow_axis, elbow_rad - elbow_max_rad_);
  } else if (elbow_rad < elbow_min_rad_) {
    touch(-elbow_axis, elbow_min_rad_ - elbow_rad);
  }

  Matrix3d inertia = moving_mass_kg_ * jacobian_squared;
  inertia.diagonal().array() += dynamics_.joint_inertia_kg_m2;
  Matrix3d resistance = inertia + (0.5 * step_s * hand_damping_N_s_per_m_ +
                                   0.25 * step_s * step_s * hand_stiffness_N_per_m_) *
                                      jacobian_squared;
  for (std::size_t i = 0; i < contact_count; ++i) {
    resistance += (step_s * dynamics_.stop_damping_Nm_s_per_rad +
                   0.25 * step_s * step_s * dynamics_.stop_stiffness_Nm_per_rad) *
                  contacts[i].axis * contacts[i].axis.transpose();
  }
  const Vector3d applied_Nm =
      motor_torque_Nm + gravity_Nm + stop_Nm + jacobian.transpose() * hand_force_D;

  // Two passes: the second knows the speeds at the middle and the end of the substep.
  Vector3d change = Vector3d::Zero();
  Vector3d friction = Vector3d::Zero();  // [N m s/rad] secant coefficient
  for (int pass = 0; pass < 2; ++pass) {
    const Vector3d end_speed = speed + change;
    for (int joint = 0; joint < 3; ++joint) {
      const double rate = std::abs(end_speed[joint]);
      const double scaled = dynamics_.coulomb_smoothing_s_per_rad * rate;
      const auto axis = static_cast<std::size_t>(joint);
      const double coulomb_Nm = dynamics_.coulomb_friction_Nm[axis];
      const double coulomb = scaled > 1e-6 ? coulomb_Nm * std::tanh(scaled) / rate
                                           : coulomb_Nm * dynamics_.coulomb_smoothing_s_per_rad;
      friction[joint] = coulomb + dynamics_.viscous_friction_Nm_s_per_rad[axis];
    }
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

  const double motor_J = motor_torque_Nm.dot(turned);
  (motor_J > 0.0 ? work_.motor_positive_J : work_.motor_negative_J) += motor_J;
  const Vector3d hand_mid_D =
      hand_force_D - (0.5 * hand_damping_N_s_per_m_ + 0.25 * step_s * hand_stiffness_N_per_m_) *
                         (jacobian * change);
  work_.hand_J += hand_mid_D.dot(jacobian * turned);
  work_.friction_J -= friction.cwiseProduct(joint_speed_rad_per_s_).dot(turned);
  work_.gravity_J += gravity_Nm.dot(turned);
  for (std::size_t i = 0; i < contact_count; ++i) {
    const double torque_Nm =
        dynamics_.stop_stiffness_Nm_per_rad *
            (contacts[i].excess_rad + 0.25 * step_s * contacts[i].axis.dot(change)) +
        dynamics_.stop_damping_Nm_s_per_rad *
            (contacts[i].rate_rad_per_s + contacts[i].axis.dot(change));
    work_.stops_J -= torque_Nm * contacts[i].axis.dot(turned);
  }
}

}  // namespace forcegrid::emulator
