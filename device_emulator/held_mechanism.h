// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>

#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// The common part of the physics of all emulated mechanisms: the hand that holds the tip, joint
/// friction, stops, energy accounts, and the division of time into substeps.
///
///   F_hand       = K (x_target - x) + B (x_target' - x')             [N], frame D
///   tau_friction = -coulomb tanh(smoothing q') - viscous q'          [N m] per joint
///   tau_stop     = -k pen - d q' beyond a stop, never pulling back in
///
/// The mechanisms integrate with fixed substeps of at most kSubstep_s by the implicit midpoint
/// rule, linearised. Friction enters through its secant coefficient at the end of the substep, so
/// that it can only brake, however light the joint.
///
/// Real-time: no allocation, lock or throw after construction. Threads: one.
class HeldMechanism {
 public:
  static constexpr double kSubstep_s = 125e-6;

  virtual ~HeldMechanism() = default;

  /// Work done on the mechanism since construction [J]. Apart from the integration error, the sum
  /// is its kinetic energy (hand's mass included).
  struct Work {
    double motor_positive_J = 0.0;  ///< delivered by the motors: power summed over the joints > 0
    double motor_negative_J = 0.0;  ///< absorbed by the motors (<= 0)
    double hand_J = 0.0;            ///< spring and damper of the hand
    double friction_J = 0.0;        ///< <= 0
    double stops_J = 0.0;
    double gravity_J = 0.0;  ///< loss of potential energy
  };

  /// Advances by `duration_s` (any length; split into equal substeps of at most kSubstep_s) with a
  /// constant motor torque [N m] at the driven joints. The hand's target [m] moves at constant
  /// speed from its place at the last call to `hand_target_D`.
  void advance(double duration_s, const Eigen::Vector3d& motor_torque_Nm,
               const Eigen::Vector3d& hand_target_D) noexcept;

  /// Puts the hand's target [m] somewhere else at once.
  void place_hand_target(const Eigen::Vector3d& hand_target_D) noexcept {
    hand_target_D_ = hand_target_D;
  }
  /// Fastens a point mass [kg] to the tip: it moves with the tip and has weight.
  void attach_tip_mass(double mass_kg) noexcept;
  /// Another hand holds the tip: mass, spring and damper go over to its within kHandChange_s, so
  /// that the force of the hand has no step. Nothing: the hand fades away, and then nothing bears
  /// the tip's weight. The mass that comes and goes does so at the tip's speed; Work does not count
  /// its energy.
  void change_hand(const std::optional<profiles::HandProfile>& hand) noexcept;
  static constexpr double kHandChange_s = 0.3;
  /// The hand lets go: from now on nothing holds the tip or bears its weight.
  void release_hand() noexcept;

  /// [m] hand's target, frame D.
  [[nodiscard]] const Eigen::Vector3d& hand_target_D() const noexcept { return hand_target_D_; }
  [[nodiscard]] const Work& work() const noexcept { return work_; }

 protected:
  /// The stops touched in one substep, each with the force -stiffness * excess - damping * rate
  /// along its axis d(excess)/dx; x are the mechanism's coordinates (joint angles or the knob's
  /// position).
  class Stops {
   public:
    /// Adds a stop that x is beyond by `excess`, unless it would pull back in.
    void touch(const Eigen::Vector3d& axis, double excess, double rate, double stiffness,
               double damping) noexcept;
    /// Adds the stops' force at the substep's initial speed.
    void add_force(Eigen::Vector3d& force) const noexcept;
    /// Adds the implicit part: the force caused by a change of speed.
    void add_resistance(double step_s, Eigen::Matrix3d& resistance) const noexcept;
    /// Adds the work [J] of a substep that changed the speed by `change` and x by `moved`.
    void add_work(double step_s, const Eigen::Vector3d& change, const Eigen::Vector3d& moved,
                  double& work_J) const noexcept;

   private:
    struct Stop {
      Eigen::Vector3d axis = Eigen::Vector3d::Zero();
      double excess = 0.0;
      double rate = 0.0;
      double stiffness = 0.0;
      double damping = 0.0;
    };
    std::array<Stop, 6> touched_;  // three joints, and three more of the linkage or the knob
    std::size_t count_ = 0;
  };

  /// One substep's input.
  struct Drive {
    double step_s = 0.0;
    Eigen::Vector3d motor_torque_Nm = Eigen::Vector3d::Zero();
    Eigen::Vector3d target_mid_D = Eigen::Vector3d::Zero();    ///< [m] at the middle of the substep
    Eigen::Vector3d target_speed_D = Eigen::Vector3d::Zero();  ///< [m/s]
  };

  HeldMechanism(const profiles::DeviceProfile::Dynamics& dynamics,
                const std::optional<profiles::HandProfile>& hand, bool hand_carries_weight,
                double gravity_m_per_s2) noexcept;
  HeldMechanism(const HeldMechanism&) = default;
  HeldMechanism& operator=(const HeldMechanism&) = default;

  virtual void substep(const Drive& drive) noexcept = 0;

  /// [N m s/rad] secant coefficients of the joints' friction at `joint_speed_rad_per_s`.
  Eigen::Vector3d friction_Nm_s_per_rad(
      const Eigen::Vector3d& joint_speed_rad_per_s) const noexcept;
  /// [N] of the hand on a tip at `position_D` [m] with `velocity_D` [m/s].
  Eigen::Vector3d hand_force_D(const Drive& drive, const Eigen::Vector3d& position_D,
                               const Eigen::Vector3d& velocity_D) const noexcept;
  /// [N s/m] By how much a change of the tip's velocity within a substep reduces the hand's force
  /// at its middle.
  double hand_resistance_N_s_per_m(double step_s) const noexcept {
    return 0.5 * hand_damping_N_s_per_m_ + 0.25 * step_s * hand_stiffness_N_per_m_;
  }
  /// [kg] `mass_kg` plus the hand's share in the implicit equation of motion.
  double mass_with_hand_kg(double mass_kg, double step_s) const noexcept {
    return mass_kg + 0.5 * step_s * hand_damping_N_s_per_m_ +
           0.25 * step_s * step_s * hand_stiffness_N_per_m_;
  }
  void account_for_motors(double motor_J) noexcept {
    (motor_J > 0.0 ? work_.motor_positive_J : work_.motor_negative_J) += motor_J;
  }

  profiles::DeviceProfile::Dynamics dynamics_;
  double moving_mass_kg_;  ///< of the tip, the hand and what is fastened to the tip
  double tip_weight_N_ = 0.0;
  bool hand_carries_weight_;
  Work work_;

 private:
  double gravity_m_per_s2_;
  double hand_mass_kg_ = 0.0;
  double hand_stiffness_N_per_m_ = 0.0;
  double hand_damping_N_s_per_m_ = 0.0;
  bool can_carry_weight_;
  struct HandGoal {
    double mass_kg = 0.0;
    double stiffness_N_per_m = 0.0;
    double damping_N_s_per_m = 0.0;
    double left_s = 0.0;  ///< until the hand is so; 0: it is
  } hand_goal_;
  void go_over_to_goal(double step_s) noexcept;
  Eigen::Vector3d hand_target_D_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::emulator
