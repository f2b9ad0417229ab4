// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "device_emulator/delta_mechanism.h"
#include "device_emulator/held_mechanism.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Physics of an emulated delta, its motors' torque and the hand that holds its knob, in the
/// coordinates x of the knob (device frame D), with R = d(theta)/dx:
///
///   M x'' + I R^T (R' x') = F_hand + R^T (tau_motor + tau_friction + tau_stop) + F_body
///   M = m 1 + I R^T R
///   m: mass at the knob + mass of the hand,   I: inertia at each driven angle
///
/// with F_hand, tau_friction and tau_stop (both per driven angle) of HeldMechanism. F_body is like
/// tau_stop, for the knob against the body: planes across and a cylinder about the device's axis. I
/// R^T R' x' is the Lagrange term of this M. The moving parts have no weight, since their separate
/// masses are not known. A mass fastened to the knob adds to m, and its weight to F_body. Where the
/// legs would not close, the knob stands still.
///
/// Real-time: advance() does not allocate, lock or throw; about 2 us per substep. Threads: one.
class DeltaModel final : public HeldMechanism {
 public:
  /// @param hand what holds the knob; nullopt: nothing holds it.
  /// @param position_D [m] where the knob starts, at rest.
  /// @param hand_carries_weight a hand bears the weight of a mass fastened to the knob.
  /// @throws std::invalid_argument when the legs do not close there.
  DeltaModel(const profiles::DeviceProfile& profile,
             const std::optional<profiles::HandProfile>& hand, const Eigen::Vector3d& position_D,
             bool hand_carries_weight = true);

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
  /// [J] 1/2 x'^T M x'.
  [[nodiscard]] double kinetic_energy_J() const noexcept;
  /// Substeps in which the knob stood still because the legs would not have closed.
  [[nodiscard]] std::uint64_t blocked_substeps() const noexcept { return blocked_substeps_; }

 private:
  void substep(const Drive& drive) noexcept override;
  [[nodiscard]] Stops stops_at(const Eigen::Vector3d& position_D, const DeltaMechanism::Pose& pose,
                               const Eigen::Vector3d& velocity_D) const noexcept;

  DeltaMechanism mechanism_;
  double joint_min_rad_;
  double joint_max_rad_;
  double knob_min_x_m_;  // in D, as is the axis of the cylinder
  double knob_max_x_m_;
  Eigen::Vector3d axis_D_;
  double knob_max_radius_m_;

  Eigen::Vector3d position_D_;
  Eigen::Vector3d velocity_D_m_per_s_ = Eigen::Vector3d::Zero();
  DeltaMechanism::Pose pose_;
  std::uint64_t blocked_substeps_ = 0;
};

}  // namespace forcegrid::emulator
