// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "device_emulator/arm_kinematics.h"
#include "device_emulator/held_mechanism.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Physics of an emulated arm, its motors' torque and the hand that holds its tip, in the joint
/// angles q:
///
///   M q'' + m J^T J' q' = tau_motor + tau_gravity + tau_friction + tau_stop + J^T F_hand
///   M = m J^T J + diag(eps),   m = tip mass of the arm + mass of the hand + weight at the tip
///   tau_gravity = -dU/dq,   U = g m_B l_B cos(theta_b) + g m_C (L_b cos(theta_b)
///                                                               - l_C cos(theta_c))
///
/// with F_hand, tau_friction and tau_stop of HeldMechanism. The links' weight U acts only on an arm
/// that is not balanced; a weight at the tip adds m_w g z. The Coriolis term m J^T J' q' is the
/// Lagrange term of this M, since diag(eps) is constant. A holding hand carries the links' weight
/// too, as a person does, so gravity does not pull the tip away from the hand's target.
///
/// The inertia is taken at the predicted midpoint. The method is of second order, free motion keeps
/// its energy to the substep's third power, and springs of any stiffness stay stable.
///
/// Real-time: advance() does not allocate, lock or throw; about 0.3 us per substep. Threads: one.
class ArmModel final : public HeldMechanism {
 public:
  /// @param hand what holds the tip; nullopt: nothing holds it.
  /// @param joint_angle_rad where the arm starts, at rest.
  /// @param hand_carries_weight a hand bears the links' weight beside its spring, as a person does
  ///   without noticing; false: the motors are expected to bear it.
  ArmModel(const profiles::DeviceProfile& profile, const std::optional<profiles::HandProfile>& hand,
           const Eigen::Vector3d& joint_angle_rad, bool hand_carries_weight = true);

  /// Sets the joints' speeds [rad/s].
  void set_joint_speed(const Eigen::Vector3d& joint_speed_rad_per_s) noexcept {
    joint_speed_rad_per_s_ = joint_speed_rad_per_s;
  }

  [[nodiscard]] const ArmKinematics& kinematics() const noexcept { return kinematics_; }
  [[nodiscard]] const Eigen::Vector3d& joint_angle_rad() const noexcept { return joint_angle_rad_; }
  [[nodiscard]] const Eigen::Vector3d& joint_speed_rad_per_s() const noexcept {
    return joint_speed_rad_per_s_;
  }
  /// [m] tip, frame D.
  [[nodiscard]] Eigen::Vector3d position_D() const noexcept {
    return kinematics_.position_D(joint_angle_rad_);
  }
  /// [J] T = 1/2 q'^T M q'.
  [[nodiscard]] double kinetic_energy_J() const noexcept;

 private:
  void substep(const Drive& drive) noexcept override;
  Eigen::Vector3d gravity_torque_Nm(const ArmKinematics::Motion& motion) const noexcept;
  Stops stops_at(const Eigen::Vector3d& joint_angle_rad,
                 const Eigen::Vector3d& joint_speed_rad_per_s) const noexcept;

  ArmKinematics kinematics_;
  bool links_weigh_;
  double gravity_b_Nm_;  // g (m_B l_B + m_C L_b)
  double gravity_c_Nm_;  // g m_C l_C
  Eigen::Vector3d joint_min_rad_;
  Eigen::Vector3d joint_max_rad_;
  double elbow_min_rad_;
  double elbow_max_rad_;

  Eigen::Vector3d joint_angle_rad_;
  Eigen::Vector3d joint_speed_rad_per_s_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::emulator
