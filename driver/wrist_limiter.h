// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "driver/force_limiter.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// What may be commanded of the motors in a wrist, and of the arm's for them.
struct LimitedTorque {
  std::uint8_t acted = 0;                                     ///< LimitFlag bits
  Eigen::Vector3d torque_D_Nm = Eigen::Vector3d::Zero();      ///< on the hand, after every limit
  Eigen::Vector3d arm_torque_Nm = Eigen::Vector3d::Zero();    ///< of joints a, b, c, for it
  Eigen::Vector3d joint_torque_Nm = Eigen::Vector3d::Zero();  ///< of the wrist's joints
  std::array<double, 3> current_A{};                          ///< of the wrist's motors
};

/// Limits the torque that a tool on a driven wrist is to exert on the hand, and turns it into joint
/// torques and currents. With p the tip, where the wrist's axes meet, the arm's and the wrist's six
/// joints exert the force f at p and the torque m about p by
///
///   (tau_arm  )   ( J_v^T  A^T ) (f)      J_v = jacobian_D, A = arm_axis_D, G = gimbal_axis_D
///   (tau_wrist) = (   0    G^T ) (m)
///
/// which is tau = J^T (f, m) of the 6 x 6 Jacobian. ForceLimiter computes J_v^T f; this the rest,
/// in this order:
///
///   1. finite:  a NaN or infinity anywhere gives zero torque and restarts the slew from zero
///   2. torque:  m <- m min(1, m_max / |m|)
///   3. slew:    m <- m_last + (m - m_last) min(1, rate dt / |m - m_last|)
///   4. joints:  m <- m min_i(1, tau_max_i / |tau_i|, I_max_i / |I_i|)
///
/// with I_i = s_i tau_i / (k_i ratio_i). Vectors are scaled as a whole, so m keeps its direction.
/// Of a device without motors in its wrist everything is zero.
/// Real-time: apply() and reset() are bounded and neither allocate, lock nor throw. Threads: one.
class WristLimiter {
 public:
  explicit WristLimiter(const profiles::DeviceProfile& profile);

  /// Whether the wrist has motors.
  [[nodiscard]] bool drives() const noexcept { return motors_.present; }

  /// @param torque_D   [N m] wanted, of the device on the hand about the tip.
  /// @param pose       with its orientation; without one everything is zero.
  /// @param elapsed_s  [s] since the last call, not negative; 0 allows no change.
  [[nodiscard]] LimitedTorque apply(const Eigen::Vector3d& torque_D, const ArmPose& pose,
                                    double elapsed_s) noexcept;

  /// The next torque grows from zero.
  void reset() noexcept { last_D_Nm_.setZero(); }

 private:
  profiles::DeviceProfile::GimbalMotors motors_;
  Eigen::Array3d current_per_torque_A_per_Nm_ = Eigen::Array3d::Zero();  ///< signed
  Eigen::Vector3d last_D_Nm_ = Eigen::Vector3d::Zero();
};

/// The six joints' torques [N m], of a, b, c and of the wrist's three, that exert `force_D` [N] at
/// the tip and `torque_D` [N m] about it: J^T (f, m). Real-time: yes. Threads: any.
[[nodiscard]] Eigen::Matrix<double, 6, 1> wrench_torques(const ArmPose& pose,
                                                         const Eigen::Vector3d& force_D,
                                                         const Eigen::Vector3d& torque_D) noexcept;

/// d(p, rotation)/d(q, g): rows x, y, z of the tip's velocity [m/rad], then of the tool's angular
/// velocity, in D; columns a, b, c and the wrist's joints. Real-time: yes. Threads: any.
[[nodiscard]] Eigen::Matrix<double, 6, 6> jacobian_6(const ArmPose& pose) noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::driver
