// SPDX-License-Identifier: Apache-2.0
#include "driver/wrist_limiter.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::driver {

using Eigen::Vector3d;

WristLimiter::WristLimiter(const profiles::DeviceProfile& profile)
    : motors_(profile.gimbal_motors) {
  if (motors_.present) {
    current_per_torque_A_per_Nm_ =
        array_of(profile.gimbal.encoder_sign) /
        (array_of(motors_.torque_constant_Nm_per_A) * array_of(motors_.ratio));
  }
}

LimitedTorque WristLimiter::apply(const Vector3d& torque_D, const ArmPose& pose,
                                  double elapsed_s) noexcept {
  LimitedTorque result;
  if (!motors_.present) {
    return result;
  }
  if (!torque_D.allFinite() || !pose.has_orientation || !std::isfinite(elapsed_s) ||
      pose.status == KinematicsStatus::kNotFinite) {
    result.acted = kLimitNotFinite;
    reset();
    return result;
  }
  Vector3d m_Nm = torque_D;
  if (const double size_Nm = m_Nm.norm(); size_Nm > motors_.max_torque_Nm) {
    m_Nm *= motors_.max_torque_Nm / size_Nm;
    result.acted |= kLimitForce;
  }
  const Vector3d change_Nm = m_Nm - last_D_Nm_;
  const double most_Nm = motors_.max_torque_rate_Nm_per_s * std::max(elapsed_s, 0.0);
  if (const double size_Nm = change_Nm.norm(); size_Nm > most_Nm) {
    m_Nm = last_D_Nm_ + change_Nm * (most_Nm / size_Nm);
    result.acted |= kLimitSlew;
  }
  last_D_Nm_ = m_Nm;

  const Vector3d tau_Nm = pose.gimbal_axis_D.transpose() * m_Nm;
  const Vector3d current_A = (current_per_torque_A_per_Nm_ * tau_Nm.array()).matrix();
  double scale = 1.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto joint = static_cast<Eigen::Index>(i);
    const double by_torque = motors_.max_joint_torque_Nm[i] / std::abs(tau_Nm[joint]);
    const double by_current = motors_.max_current_A[i] / std::abs(current_A[joint]);
    result.acted |= by_torque < 1.0 ? kLimitTorque : 0;
    result.acted |= by_current < 1.0 ? kLimitCurrent : 0;
    scale = std::min({scale, by_torque, by_current});
  }
  result.torque_D_Nm = scale * m_Nm;
  result.arm_torque_Nm = pose.arm_axis_D.transpose() * result.torque_D_Nm;
  result.joint_torque_Nm = scale * tau_Nm;
  for (std::size_t i = 0; i < 3; ++i) {
    result.current_A[i] = scale * current_A[static_cast<Eigen::Index>(i)];
  }
  return result;
}

Eigen::Matrix<double, 6, 6> jacobian_6(const ArmPose& pose) noexcept {
  Eigen::Matrix<double, 6, 6> jacobian = Eigen::Matrix<double, 6, 6>::Zero();
  jacobian.topLeftCorner<3, 3>() = pose.jacobian_D;
  jacobian.bottomLeftCorner<3, 3>() = pose.arm_axis_D;
  jacobian.bottomRightCorner<3, 3>() = pose.gimbal_axis_D;
  return jacobian;
}

Eigen::Matrix<double, 6, 1> wrench_torques(const ArmPose& pose, const Vector3d& force_D,
                                           const Vector3d& torque_D) noexcept {
  Eigen::Matrix<double, 6, 1> wrench;
  wrench << force_D, torque_D;
  return jacobian_6(pose).transpose() * wrench;
}

}  // namespace forcegrid::driver
