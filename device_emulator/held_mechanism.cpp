// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/held_mechanism.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::emulator {

using Eigen::Matrix3d;
using Eigen::Vector3d;

HeldMechanism::HeldMechanism(const profiles::DeviceProfile::Dynamics& dynamics,
                             const std::optional<profiles::HandProfile>& hand,
                             bool hand_carries_weight, double gravity_m_per_s2) noexcept
    : dynamics_(dynamics),
      moving_mass_kg_(dynamics.tip_mass_kg),
      hand_carries_weight_(hand.has_value() && hand_carries_weight),
      gravity_m_per_s2_(gravity_m_per_s2),
      can_carry_weight_(hand_carries_weight) {
  if (hand) {
    hand_mass_kg_ = hand->mass_kg;
    moving_mass_kg_ += hand_mass_kg_;
    hand_stiffness_N_per_m_ = hand->stiffness_N_per_m;
    hand_damping_N_s_per_m_ = hand->damping_N_s_per_m;
  }
}

void HeldMechanism::attach_tip_mass(double mass_kg) noexcept {
  moving_mass_kg_ += mass_kg;
  tip_weight_N_ += mass_kg * gravity_m_per_s2_;
}

void HeldMechanism::change_hand(const std::optional<profiles::HandProfile>& hand) noexcept {
  hand_goal_ = {0.0, 0.0, 0.0, kHandChange_s};
  if (hand) {
    hand_goal_ = {hand->mass_kg, hand->stiffness_N_per_m, hand->damping_N_s_per_m, kHandChange_s};
    hand_carries_weight_ = can_carry_weight_;
  }
}

void HeldMechanism::go_over_to_goal(double step_s) noexcept {
  if (hand_goal_.left_s <= 0.0) {
    return;
  }
  const double share = std::min(1.0, step_s / hand_goal_.left_s);
  hand_goal_.left_s -= step_s;
  const double mass_kg = hand_mass_kg_ + share * (hand_goal_.mass_kg - hand_mass_kg_);
  moving_mass_kg_ += mass_kg - hand_mass_kg_;
  hand_mass_kg_ = mass_kg;
  hand_stiffness_N_per_m_ += share * (hand_goal_.stiffness_N_per_m - hand_stiffness_N_per_m_);
  hand_damping_N_s_per_m_ += share * (hand_goal_.damping_N_s_per_m - hand_damping_N_s_per_m_);
  if (hand_goal_.left_s <= 0.0 && hand_goal_.stiffness_N_per_m == 0.0) {
    hand_carries_weight_ = false;
  }
}

void HeldMechanism::release_hand() noexcept {
  hand_goal_ = {};
  moving_mass_kg_ -= hand_mass_kg_;
  hand_mass_kg_ = hand_stiffness_N_per_m_ = hand_damping_N_s_per_m_ = 0.0;
  hand_carries_weight_ = false;
}

void HeldMechanism::advance(double duration_s, const Vector3d& motor_torque_Nm,
                            const Vector3d& hand_target_D) noexcept {
  if (!(duration_s > 0.0)) {
    return;
  }
  const double substeps = std::ceil(duration_s / kSubstep_s - 1e-9);
  const Vector3d target_start_D = hand_target_D_;
  Drive drive;
  drive.step_s = duration_s / substeps;
  drive.motor_torque_Nm = motor_torque_Nm;
  drive.target_speed_D = (hand_target_D - target_start_D) / duration_s;
  for (double i = 0.0; i < substeps; i += 1.0) {
    drive.target_mid_D = target_start_D + (i + 0.5) * drive.step_s * drive.target_speed_D;
    go_over_to_goal(drive.step_s);
    substep(drive);
  }
  hand_target_D_ = hand_target_D;
}

Vector3d HeldMechanism::friction_Nm_s_per_rad(
    const Vector3d& joint_speed_rad_per_s) const noexcept {
  Vector3d friction;
  for (int joint = 0; joint < 3; ++joint) {
    const double speed = std::abs(joint_speed_rad_per_s[joint]);
    const double scaled = dynamics_.coulomb_smoothing_s_per_rad * speed;
    const auto axis = static_cast<std::size_t>(joint);
    const double coulomb_Nm = dynamics_.coulomb_friction_Nm[axis];
    const double coulomb = scaled > 1e-6 ? coulomb_Nm * std::tanh(scaled) / speed
                                         : coulomb_Nm * dynamics_.coulomb_smoothing_s_per_rad;
    friction[joint] = coulomb + dynamics_.viscous_friction_Nm_s_per_rad[axis];
  }
  return friction;
}

Vector3d HeldMechanism::hand_force_D(const Drive& drive, const Vector3d& position_D,
                                     const Vector3d& velocity_D) const noexcept {
  return hand_stiffness_N_per_m_ * (drive.target_mid_D - position_D) +
         hand_damping_N_s_per_m_ * (drive.target_speed_D - velocity_D);
}

void HeldMechanism::Stops::touch(const Vector3d& axis, double excess, double rate, double stiffness,
                                 double damping) noexcept {
  if (excess > 0.0 && stiffness * excess + damping * rate > 0.0) {
    touched_[count_++] = {axis, excess, rate, stiffness, damping};
  }
}

void HeldMechanism::Stops::add_force(Vector3d& force) const noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    const Stop& stop = touched_[i];
    force -= stop.axis * (stop.stiffness * stop.excess + stop.damping * stop.rate);
  }
}

void HeldMechanism::Stops::add_resistance(double step_s, Matrix3d& resistance) const noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    const Stop& stop = touched_[i];
    resistance += (step_s * stop.damping + 0.25 * step_s * step_s * stop.stiffness) * stop.axis *
                  stop.axis.transpose();
  }
}

void HeldMechanism::Stops::add_work(double step_s, const Vector3d& change, const Vector3d& moved,
                                    double& work_J) const noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    const Stop& stop = touched_[i];
    const double force = stop.stiffness * (stop.excess + 0.25 * step_s * stop.axis.dot(change)) +
                         stop.damping * (stop.rate + stop.axis.dot(change));
    work_J -= force * stop.axis.dot(moved);
  }
}

}  // namespace forcegrid::emulator
