// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "device_emulator/wrist.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Physics of a wrist with motors, in a hand that holds the tool's handle by a rotational spring
/// and damper. With R the tool's frame in D, R_h where the hand wants it, G the axes of the wrist's
/// joints and w_g = G g' the part of the tool's angular velocity that the wrist makes:
///
///   m_hand = K rotvec(R_h R^T) - B (w_g - w_h)          [N m] on the tool, D
///   I g''  = tau_motor + G^T m_hand - b g' + tau_stop
///
/// The joints have their inertia alone; the hand's is in its spring and damper. Substeps of
/// kSubstep_s, speed before angle. The hand's moment also loads the arm's joints: arm_torque_Nm().
/// Written from the profile; includes nothing of the driver.
/// Real-time: advance() neither allocates, locks nor throws. Threads: one.
class DrivenWrist {
 public:
  static constexpr double kSubstep_s = 125e-6;

  DrivenWrist(const profiles::DeviceProfile& profile, const Eigen::Vector3d& angle_rad);

  /// Moves on by `duration_s` at constant motor torque [N m], while the hand turns its target
  /// evenly to `target_rad` (joint angles). @param linkage_angle_rad theta of the arm.
  void advance(double duration_s, const Eigen::Vector3d& motor_torque_Nm,
               const Eigen::Vector3d& target_rad,
               const Eigen::Vector3d& linkage_angle_rad) noexcept;

  /// From now on nothing holds the handle, or something does.
  void hold(bool held) noexcept { held_ = held; }

  [[nodiscard]] const Eigen::Vector3d& angle_rad() const noexcept { return angle_rad_; }
  /// [N m] of the hand on the tool, D, at the end of the last substep.
  [[nodiscard]] const Eigen::Vector3d& hand_torque_D() const noexcept { return hand_torque_D_; }
  /// [N m] What the hand's moment exerts on the arm's joints q, whose linkage turns by
  /// `linkage_sign` times q.
  [[nodiscard]] Eigen::Vector3d arm_torque_Nm(const Eigen::Vector3d& linkage_angle_rad,
                                              const Eigen::Vector3d& linkage_sign) const noexcept;

 private:
  void substep(double step_s, const Eigen::Vector3d& motor_torque_Nm,
               const Eigen::Vector3d& target_rad, const Eigen::Vector3d& target_speed_rad_per_s,
               const Eigen::Vector3d& linkage_angle_rad) noexcept;

  Wrist geometry_;
  profiles::DeviceProfile::GimbalMotors motors_;
  Eigen::Vector3d angle_rad_;
  Eigen::Vector3d speed_rad_per_s_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d target_rad_;
  Eigen::Vector3d hand_torque_D_ = Eigen::Vector3d::Zero();
  bool held_ = true;
};

}  // namespace forcegrid::emulator
