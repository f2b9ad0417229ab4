// SPDX-License-Identifier: Apache-2.0
#include "driver/force_limiter.h"

#include <algorithm>
#include <cmath>

#include "driver/kinematics.h"

namespace forcegrid::driver {
namespace {

/// `vector`, shortened to `max_length`.
Eigen::Vector3d shortened(const Eigen::Vector3d& vector, double max_length, bool& acted) noexcept {
  // Divided by its largest element first: the square of a huge finite one would overflow.
  const double largest = vector.cwiseAbs().maxCoeff();
  if (largest == 0.0) {
    return vector;
  }
  const Eigen::Vector3d relative = vector / largest;
  if (largest * relative.norm() <= max_length) {
    return vector;
  }
  acted = true;
  return relative.normalized() * max_length;
}

/// The factor in [0, 1] that brings every element of `values` within +-`limits`.
double scale_within(const Eigen::Array3d& values, const Eigen::Array3d& limits) noexcept {
  const double excess = (values.abs() / limits).maxCoeff();
  return excess > 1.0 ? 1.0 / excess : 1.0;
}

}  // namespace

ForceLimiter::ForceLimiter(const profiles::DeviceProfile& profile)
    : current_per_torque_A_per_Nm_(Eigen::Array3d::Zero()),
      max_force_N_(profile.limits.max_force_N),
      max_force_rate_N_per_s_(profile.limits.max_force_rate_N_per_s),
      max_joint_torque_Nm_(array_of(profile.limits.max_joint_torque_Nm)),
      max_current_A_(array_of(profile.motors.max_current_A)) {
  if (profile.kind == profiles::DeviceKind::kDelta) {
    max_joint_torque_Nm_ =
        max_joint_torque_Nm_.min(profile.falcon.command_limit / profile.falcon.torque_gain_per_Nm);
    max_current_A_.setOnes();
  } else {
    current_per_torque_A_per_Nm_ =
        ArmKinematics(profile).motor_current_A(Eigen::Vector3d::Ones()).array();
  }
}

LimitedForce ForceLimiter::apply(const Eigen::Vector3d& force_D, const ArmPose& pose,
                                 double elapsed_s,
                                 const Eigen::Vector3d& extra_torque_Nm) noexcept {
  LimitedForce result;
  if (!force_D.allFinite() || pose.status == KinematicsStatus::kNotFinite ||
      pose.status == KinematicsStatus::kUnreachable || !pose.jacobian_D.allFinite() ||
      !std::isfinite(elapsed_s) || !extra_torque_Nm.allFinite()) {
    reset();
    result.acted = kLimitNotFinite;
    return result;
  }

  bool force_acted = false;
  bool slew_acted = false;
  const Eigen::Vector3d bounded_D = shortened(force_D, max_force_N_, force_acted);
  const double max_step_N = max_force_rate_N_per_s_ * std::max(elapsed_s, 0.0);
  result.force_D = last_force_D_ + shortened(bounded_D - last_force_D_, max_step_N, slew_acted);
  last_force_D_ = result.force_D;

  const Eigen::Vector3d torque_Nm =
      ArmKinematics::joint_torque(pose, result.force_D) + extra_torque_Nm;
  const double torque_scale = scale_within(torque_Nm.array(), max_joint_torque_Nm_);
  const Eigen::Array3d current_A =
      current_per_torque_A_per_Nm_ * (torque_scale * torque_Nm).array();
  const double current_scale = scale_within(current_A, max_current_A_);
  result.torque_scale = current_scale * torque_scale;
  result.joint_torque_Nm = current_scale * torque_scale * torque_Nm;
  if (!result.joint_torque_Nm.allFinite() || !current_A.allFinite()) {
    reset();
    return {.acted = kLimitNotFinite};
  }
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    // Rounding of the scale may leave the last bit above the limit.
    result.current_A[i] =
        std::clamp(current_scale * current_A[axis], -max_current_A_[axis], max_current_A_[axis]);
  }
  result.acted = static_cast<std::uint8_t>(
      (force_acted ? kLimitForce : 0) | (slew_acted ? kLimitSlew : 0) |
      (torque_scale < 1.0 ? kLimitTorque : 0) | (current_scale < 1.0 ? kLimitCurrent : 0));
  return result;
}

}  // namespace forcegrid::driver
