#pragma once

#include <Eigen/Core>
#include <optional>

#include "device_emulator/arm_kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Physics of the emulated arm, its motors' torque and the hand that holds its tip.
///
///   M q'' + m J^T J' q' = tau_motor + tau_gravity + tau_friction + tau_stop + J^T F_hand
///   M = m J^T J + diag(eps),   m = tip mass of the arm + mass of the hand + weight at the tip
///   F_hand        = K (x_target - x) + B (x_target' - x')               [N], frame D
///   tau_friction  = -coulomb tanh(smoothing q') - viscous q'            [N m] per joint
///   tau_stop      = -k pen - d q' beyond a stop, never pulling back in  [N m]
///   tau_gravity   = -dU/dq,
///                   U = g m_B l_B cos(theta_b) + g m_C (L_b cos(theta_b) - l_C cos(theta_c)),
///                   only for an arm that is not balanced, and m_w g z of a weight at the tip
///
/// M's Coriolis term m J^T J' q' is the Lagrange one of this M (diag(eps) is constant). A holding
/// hand carries the links' weight too, as a person does, so gravity then does not pull the tip away
/// from the hand's target.
///
/// Integrated with fixed substeps of kSubstep_s by the implicit midpoint rule, linearised, with the
/// inertia taken at the predicted midpoint: second order, free motion keeps its energy to the
/// substep's third power, springs of any stiffness stay stable. Friction enters through its secant
/// coefficient at the end of the substep, so that it can only brake, however light the joint.
///
/// Real-time: advance() neither allocates, locks nor throws; about 0.3 us a substep.
/// Threads: one.
class ArmModel {
 public:
  static constexpr double kSubstep_s = 125e-6;

  /// Work done on the arm since construction [J]; its kinetic energy (hand's mass included) is the
  /// sum but for the integration error, with gravity_J the loss of potential energy.
  struct Work {
    double motor_positive_J = 0.0;  ///< delivered by the motors: power summed over the joints > 0
    double motor_negative_J = 0.0;  ///< taken up by the motors (<= 0)
    double hand_J = 0.0;            ///< spring and damper of the hand
    double friction_J = 0.0;        ///< <= 0
    double stops_J = 0.0;
    double gravity_J = 0.0;
  };

  /// @param hand what holds the tip; nullopt: nothing.
  /// @param joint_angle_rad where the arm starts, at rest.
  /// @param hand_carries_weight a hand bears the links' weight beside its spring, as a person does
  ///        without noticing; false: the motors are expected to.
  ArmModel(const profiles::DeviceProfile& profile, std::optional<profiles::HandProfile> hand,
           const Eigen::Vector3d& joint_angle_rad, bool hand_carries_weight = true);

  /// Advances by `duration_s` (any length; split into equal substeps of at most kSubstep_s) with a
  /// constant motor torque [N m] at the joints and the hand's target [m] moving at constant speed
  /// from its place at the last call to `hand_target_D`.
  void advance(double duration_s, const Eigen::Vector3d& motor_torque_Nm,
               const Eigen::Vector3d& hand_target_D) noexcept;

  /// Puts the hand's target [m] somewhere else without moving it there.
  void place_hand_target(const Eigen::Vector3d& hand_target_D) noexcept {
    hand_target_D_ = hand_target_D;
  }
  /// A mass [kg] is fastened to the tip, a point: it is moved along and has weight.
  void attach_tip_mass(double mass_kg) noexcept;
  /// The hand lets go: from now on nothing holds the tip or bears its weight.
  void release_hand() noexcept;
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
  /// [m] hand's target, frame D.
  [[nodiscard]] const Eigen::Vector3d& hand_target_D() const noexcept { return hand_target_D_; }
  /// [J] T = 1/2 q'^T M q'.
  [[nodiscard]] double kinetic_energy_J() const noexcept;
  [[nodiscard]] const Work& work() const noexcept { return work_; }

 private:
  void substep(double step_s, const Eigen::Vector3d& motor_torque_Nm,
               const Eigen::Vector3d& target_mid_D, const Eigen::Vector3d& target_speed_D) noexcept;
  Eigen::Vector3d gravity_torque_Nm(const ArmKinematics::Motion& motion) const noexcept;

  ArmKinematics kinematics_;
  profiles::DeviceProfile::Dynamics dynamics_;
  bool links_weigh_;
  bool hand_carries_weight_;
  double gravity_b_Nm_;  // g (m_B l_B + m_C L_b)
  double gravity_c_Nm_;  // g m_C l_C
  Eigen::Vector3d joint_min_rad_;
  Eigen::Vector3d joint_max_rad_;
  double elbow_min_rad_;
  double elbow_max_rad_;
  double moving_mass_kg_;
  double tip_weight_N_ = 0.0;
  double acceleration_m_per_s2_;
  double hand_mass_kg_ = 0.0;
  double hand_stiffness_N_per_m_ = 0.0;
  double hand_damping_N_s_per_m_ = 0.0;

  Eigen::Vector3d joint_angle_rad_;
  Eigen::Vector3d joint_speed_rad_per_s_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d hand_target_D_;
  Work work_;
};

}  // namespace forcegrid::emulator
