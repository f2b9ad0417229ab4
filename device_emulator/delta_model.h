#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "device_emulator/delta_mechanism.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Physics of the emulated delta, its motors' torque and the hand that holds its knob, in the
/// coordinates x of the knob (device frame D), with R = d(theta)/dx:
///
///   M x'' + I R^T (R' x') = F_hand + R^T (tau_motor + tau_friction + tau_stop) + F_body
///   M = m 1 + I R^T R,   m = mass at the knob + mass of the hand
///                        I = inertia at each driven angle
///   F_hand       = K (x_target - x) + B (x_target' - x')                [N]
///   tau_friction = -coulomb tanh(smoothing theta') - viscous theta'     [N m] per driven angle
///   tau_stop     = -k pen - d theta' beyond a driven angle's stop, never pulling back in
///   F_body       = the same for the knob against the body: planes across and a cylinder about
///                  the device's axis
///
/// I R^T R' x' is the Lagrange term of this M. The moving parts are without weight: their masses
/// are not known apart. A mass that is fastened to the knob adds to m, and its weight to F_body.
///
/// Integrated like ArmModel, with fixed substeps of kSubstep_s by the implicit midpoint rule,
/// linearised; friction enters through its secant coefficient at the end of the substep, so that it
/// can only brake. A knob that is forced to where the legs do not close stands still.
///
/// Real-time: advance() neither allocates, locks nor throws; about 2 us a substep. Threads: one.
class DeltaModel {
 public:
  static constexpr double kSubstep_s = 125e-6;

  /// Work done on the mechanism since construction [J]; its kinetic energy (hand's mass included)
  /// is the sum but for the integration error.
  struct Work {
    double motor_positive_J = 0.0;  ///< delivered by the motors: power summed over the joints > 0
    double motor_negative_J = 0.0;  ///< taken up by the motors (<= 0)
    double hand_J = 0.0;            ///< spring and damper of the hand
    double friction_J = 0.0;        ///< <= 0
    double stops_J = 0.0;
    double gravity_J = 0.0;  ///< weight of what is fastened to the knob
  };

  /// @param hand what holds the knob; nullopt: nothing.
  /// @param position_D [m] where the knob starts, at rest.
  /// @param hand_carries_weight a hand bears the weight of what is fastened to the knob.
  /// @throws std::invalid_argument when the legs do not close there.
  DeltaModel(const profiles::DeviceProfile& profile, std::optional<profiles::HandProfile> hand,
             const Eigen::Vector3d& position_D, bool hand_carries_weight = true);

  /// Advances by `duration_s` (any length; split into equal substeps of at most kSubstep_s) with a
  /// constant motor torque [N m] at the driven angles and the hand's target [m] moving at constant
  /// speed from its place at the last call to `hand_target_D`.
  void advance(double duration_s, const Eigen::Vector3d& motor_torque_Nm,
               const Eigen::Vector3d& hand_target_D) noexcept;

  /// Puts the hand's target [m] somewhere else without moving it there.
  void place_hand_target(const Eigen::Vector3d& hand_target_D) noexcept {
    hand_target_D_ = hand_target_D;
  }
  /// A mass [kg] is fastened to the knob, a point: it is moved along and has weight.
  void attach_tip_mass(double mass_kg) noexcept;
  /// The hand lets go: from now on nothing holds the knob or bears its weight.
  void release_hand() noexcept;
  /// Sets the knob's velocity [m/s].
  void set_velocity(const Eigen::Vector3d& velocity_D_m_per_s) noexcept {
    velocity_D_m_per_s_ = velocity_D_m_per_s;
  }

  [[nodiscard]] const DeltaMechanism& mechanism() const noexcept { return mechanism_; }
  /// [m] knob, frame D.
  [[nodiscard]] const Eigen::Vector3d& position_D() const noexcept { return position_D_; }
  [[nodiscard]] const Eigen::Vector3d& velocity_D_m_per_s() const noexcept {
    return velocity_D_m_per_s_;
  }
  /// [rad] driven angles of legs 1 to 3.
  [[nodiscard]] const Eigen::Vector3d& joint_angle_rad() const noexcept {
    return pose_.joint_angle_rad;
  }
  [[nodiscard]] const Eigen::Vector3d& hand_target_D() const noexcept { return hand_target_D_; }
  /// [J] 1/2 x'^T M x'.
  [[nodiscard]] double kinetic_energy_J() const noexcept;
  [[nodiscard]] const Work& work() const noexcept { return work_; }
  /// Substeps in which the knob stood still because the legs would not have closed.
  [[nodiscard]] std::uint64_t blocked_substeps() const noexcept { return blocked_substeps_; }

 private:
  /// One stop that is touched: force -stiffness * excess - damping * rate along `axis_D`.
  struct Contact {
    Eigen::Vector3d axis_D = Eigen::Vector3d::Zero();  // d(excess)/dx
    double excess = 0.0;
    double rate = 0.0;
    double stiffness = 0.0;
    double damping = 0.0;
  };
  struct Contacts {
    std::array<Contact, 6> list;
    std::size_t count = 0;
  };

  void substep(double step_s, const Eigen::Vector3d& motor_torque_Nm,
               const Eigen::Vector3d& target_mid_D, const Eigen::Vector3d& target_speed_D) noexcept;
  [[nodiscard]] Contacts contacts_at(const Eigen::Vector3d& position_D,
                                     const DeltaMechanism::Pose& pose,
                                     const Eigen::Vector3d& velocity_D) const noexcept;

  DeltaMechanism mechanism_;
  profiles::DeviceProfile::Dynamics dynamics_;
  double joint_min_rad_;
  double joint_max_rad_;
  double knob_min_x_m_;  // in D, as is the axis of the cylinder
  double knob_max_x_m_;
  Eigen::Vector3d axis_D_;
  double knob_max_radius_m_;
  double moving_mass_kg_;
  double tip_weight_N_ = 0.0;
  bool hand_carries_weight_;
  double hand_mass_kg_ = 0.0;
  double hand_stiffness_N_per_m_ = 0.0;
  double hand_damping_N_s_per_m_ = 0.0;

  Eigen::Vector3d position_D_;
  Eigen::Vector3d velocity_D_m_per_s_ = Eigen::Vector3d::Zero();
  DeltaMechanism::Pose pose_;
  Eigen::Vector3d hand_target_D_;
  Work work_;
  std::uint64_t blocked_substeps_ = 0;
};

}  // namespace forcegrid::emulator
