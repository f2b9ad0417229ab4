// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// Which limits acted, as bits of LimitedForce::acted.
enum LimitFlag : std::uint8_t {
  kLimitNotFinite = 1,  ///< an input was NaN or infinite: everything is zero
  kLimitForce = 2,      ///< the force vector was shortened
  kLimitSlew = 4,       ///< the force vector's change was shortened
  kLimitTorque = 8,     ///< the joint torques were scaled down
  kLimitCurrent = 16,   ///< the motor currents were scaled down
  kLimitWarm = 32,      ///< the same because a motor is warm; by servo::CommandLimiter
};

/// What may be commanded after the limits.
struct LimitedForce {
  std::uint8_t acted = 0;                                     ///< LimitFlag bits
  Eigen::Vector3d force_D = Eigen::Vector3d::Zero();          ///< [N] after force and slew limit
  Eigen::Vector3d joint_torque_Nm = Eigen::Vector3d::Zero();  ///< after every limit
  std::array<double, 3> current_A{};                          ///< after every limit
  double torque_scale = 1.0;  ///< factor of steps 4 and 5 on all torque, the extra one included
};

/// Limits the wanted force and turns it into joint torques and motor currents, in this order:
///
///   1. finite:  a NaN or infinity anywhere gives zero force and restarts the slew from zero
///   2. force:   F <- F min(1, F_max / |F|)
///   3. slew:    F <- F_last + (F - F_last) min(1, rate dt / |F - F_last|)
///   4. torque:  tau = J^T F + tau_extra,  tau <- tau min_i(1, tau_max_i / |tau_i|)
///   5. current: I = I(tau),  I <- I min_i(1, I_max_i / |I_i|)
///
/// A delta's commands are torques: its tau_max_i is at most what its largest command gives, its
/// currents are zero, and step 5 does nothing. Vectors are scaled as a whole, so steps 2, 4 and 5
/// keep their direction. All arithmetic is in double; the currents fit the report, whose encoder
/// clamps once more. Real-time: apply() and reset() are bounded and neither allocate, lock
/// nor throw. Threads: one.
class ForceLimiter {
 public:
  explicit ForceLimiter(const profiles::DeviceProfile& profile);

  /// @param force_D         [N] wanted force of the device on the hand.
  /// @param pose            from ArmKinematics; kNotFinite counts as a NaN.
  /// @param elapsed_s       [s] since the last call, not negative; 0 allows no change of force.
  /// @param extra_torque_Nm [Nm] e.g. gravity compensation; neither force- nor slew-limited.
  [[nodiscard]] LimitedForce apply(
      const Eigen::Vector3d& force_D, const ArmPose& pose, double elapsed_s,
      const Eigen::Vector3d& extra_torque_Nm = Eigen::Vector3d::Zero()) noexcept;

  /// The next force grows from zero.
  void reset() noexcept { last_force_D_.setZero(); }

 private:
  Eigen::Array3d current_per_torque_A_per_Nm_;  ///< signed; zero for a delta
  double max_force_N_;
  double max_force_rate_N_per_s_;
  Eigen::Array3d max_joint_torque_Nm_;
  Eigen::Array3d max_current_A_;
  Eigen::Vector3d last_force_D_ = Eigen::Vector3d::Zero();
};

#pragma GCC visibility pop
}  // namespace forcegrid::driver
