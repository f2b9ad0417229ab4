// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/delta_model.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <stdexcept>

namespace forcegrid::emulator {

using Eigen::Matrix3d;
using Eigen::Vector3d;

DeltaModel::DeltaModel(const profiles::DeviceProfile& profile,
                       const std::optional<profiles::HandProfile>& hand, const Vector3d& position_D,
                       bool hand_carries_weight)
    : HeldMechanism(profile.dynamics, hand, hand_carries_weight,
                    profiles::kStandardGravity_m_per_s2),
      mechanism_(profile.delta),
      joint_min_rad_(profile.delta.joint_min_rad),
      joint_max_rad_(profile.delta.joint_max_rad),
      knob_min_x_m_(profile.delta.knob_min_z_m - profile.delta.center_m[2]),
      knob_max_x_m_(profile.delta.knob_max_z_m - profile.delta.center_m[2]),
      axis_D_(mechanism_.from_base(Vector3d::Zero())),
      knob_max_radius_m_(profile.delta.knob_max_radius_m),
      position_D_(position_D) {
  const auto pose = mechanism_.pose(position_D);
  if (!pose) {
    throw std::invalid_argument("the delta of profile " + profile.name +
                                " can't start where its legs do not close; correct delta.center_m");
  }
  pose_ = *pose;
  place_hand_target(position_D);
}

double DeltaModel::kinetic_energy_J() const noexcept {
  return 0.5 * moving_mass_kg_ * velocity_D_m_per_s_.squaredNorm() +
         0.5 * dynamics_.joint_inertia_kg_m2 *
             (pose_.rate_rad_per_m * velocity_D_m_per_s_).squaredNorm();
}

HeldMechanism::Stops DeltaModel::stops_at(const Vector3d& position_D,
                                          const DeltaMechanism::Pose& pose,
                                          const Vector3d& velocity_D) const noexcept {
  Stops stops;
  const auto touch = [&](const Vector3d& axis_D, double excess, double stiffness, double damping) {
    stops.touch(axis_D, excess, axis_D.dot(velocity_D), stiffness, damping);
  };
  for (int leg = 0; leg < 3; ++leg) {
    const Vector3d axis_D = pose.rate_rad_per_m.row(leg).transpose();
    const double angle_rad = pose.joint_angle_rad[leg];
    const bool beyond = angle_rad > joint_max_rad_;
    touch(beyond ? axis_D : Vector3d(-axis_D),
          beyond ? angle_rad - joint_max_rad_ : joint_min_rad_ - angle_rad,
          dynamics_.stop_stiffness_Nm_per_rad, dynamics_.stop_damping_Nm_s_per_rad);
  }
  const bool outward = position_D.x() > knob_max_x_m_;
  touch(outward ? Vector3d(Vector3d::UnitX()) : Vector3d(-Vector3d::UnitX()),
        outward ? position_D.x() - knob_max_x_m_ : knob_min_x_m_ - position_D.x(),
        dynamics_.knob_stop_stiffness_N_per_m, dynamics_.knob_stop_damping_N_s_per_m);
  const Vector3d radial_D(0.0, position_D.y() - axis_D_.y(), position_D.z() - axis_D_.z());
  const double radius_m = radial_D.norm();
  if (radius_m > knob_max_radius_m_) {
    touch(radial_D / radius_m, radius_m - knob_max_radius_m_, dynamics_.knob_stop_stiffness_N_per_m,
          dynamics_.knob_stop_damping_N_s_per_m);
  }
  return stops;
}

void DeltaModel::substep(const Drive& drive) noexcept {
  const double step_s = drive.step_s;
  const Vector3d velocity_D = velocity_D_m_per_s_;
  const Vector3d position_mid_D = position_D_ + 0.5 * step_s * velocity_D;
  const auto at_mid = mechanism_.pose(position_mid_D);
  if (!at_mid) {
    velocity_D_m_per_s_.setZero();
    ++blocked_substeps_;
    return;
  }
  const Matrix3d& rate = at_mid->rate_rad_per_m;
  const Matrix3d rate_squared = rate.transpose() * rate;

  // Forces at the predicted midpoint with the initial velocity; `resistance`, the implicit part,
  // holds what the change of velocity adds.
  const Vector3d hand_N = hand_force_D(drive, position_mid_D, velocity_D);
  const Vector3d weight_N(0.0, 0.0, hand_carries_weight_ ? 0.0 : -tip_weight_N_);
  const Stops stops = stops_at(position_mid_D, *at_mid, velocity_D);
  Vector3d applied_N = hand_N + weight_N + rate.transpose() * drive.motor_torque_Nm;
  stops.add_force(applied_N);

  Matrix3d resistance = dynamics_.joint_inertia_kg_m2 * rate_squared;
  resistance.diagonal().array() += mass_with_hand_kg(moving_mass_kg_, step_s);
  stops.add_resistance(step_s, resistance);

  // Two passes: the second one has the velocities at the middle and the end of the substep.
  Vector3d change_D = Vector3d::Zero();
  Vector3d friction = Vector3d::Zero();
  for (int pass = 0; pass < 2; ++pass) {
    friction = friction_Nm_s_per_rad(rate * (velocity_D + change_D));
    const Matrix3d braking = rate.transpose() * friction.asDiagonal() * rate;
    const Vector3d bias = mechanism_.bias_rad_per_s2(position_mid_D, velocity_D + 0.5 * change_D);
    const Matrix3d system = resistance + step_s * braking;
    change_D =
        system.llt().solve(step_s * (applied_N - braking * velocity_D -
                                     dynamics_.joint_inertia_kg_m2 * rate.transpose() * bias));
  }

  const Vector3d moved_D = step_s * (velocity_D + 0.5 * change_D);
  const auto at_end = mechanism_.pose(position_D_ + moved_D);
  if (!at_end) {
    velocity_D_m_per_s_.setZero();
    ++blocked_substeps_;
    return;
  }
  const Vector3d turned_rad = at_end->joint_angle_rad - pose_.joint_angle_rad;
  velocity_D_m_per_s_ = velocity_D + change_D;
  position_D_ += moved_D;
  pose_ = *at_end;

  account_for_motors(drive.motor_torque_Nm.dot(turned_rad));
  const Vector3d hand_mid_N = hand_N - hand_resistance_N_s_per_m(step_s) * change_D;
  work_.hand_J += hand_mid_N.dot(moved_D);
  work_.gravity_J += weight_N.dot(moved_D);
  work_.friction_J -= friction.cwiseProduct(rate * velocity_D_m_per_s_).dot(rate * moved_D);
  stops.add_work(step_s, change_D, moved_D, work_.stops_J);
}

}  // namespace forcegrid::emulator
