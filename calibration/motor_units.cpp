// SPDX-License-Identifier: Apache-2.0
#include "calibration/motor_units.h"

#include <cmath>

#include "driver/kinematics.h"
#include "rt/vectors.h"

namespace forcegrid::calibration {
namespace {

// A report's number is truncated toward zero; adding a quarter survives both that and rounding.
constexpr double kSurvivesTruncation = 0.25;

}  // namespace

MotorUnits::MotorUnits(const profiles::DeviceProfile& profile) noexcept
    : delta_(profile.kind == profiles::DeviceKind::kDelta),
      max_torque_Nm_(rt::to_vector(profile.limits.max_joint_torque_Nm).array()) {
  if (delta_) {
    torque_per_unit_Nm_.setConstant(-1.0 / profile.falcon.torque_gain_per_Nm);
    return;
  }
  torque_per_unit_Nm_ =
      1e-3 * driver::ArmKinematics(profile).joint_torque_of_current(Eigen::Vector3d::Ones());
  max_torque_Nm_ = max_torque_Nm_.min(1e3 * rt::to_vector(profile.motors.max_current_A).array() *
                                      torque_per_unit_Nm_.abs());
}

MotorUnits::Command MotorUnits::nearest(const Eigen::Vector3d& joint_torque_Nm,
                                        const Eigen::Vector3d& limit_Nm) const noexcept {
  Command command;
  for (Eigen::Index joint = 0; joint < 3; ++joint) {
    const double unit_Nm = torque_per_unit_Nm_[joint];
    const double most = std::floor(std::abs(limit_Nm[joint] / unit_Nm));
    const double wanted = joint_torque_Nm[joint] / unit_Nm;
    const double units =
        std::isfinite(wanted) ? std::round(std::max(-most, std::min(most, wanted))) : 0.0;
    const double sent = units + (units == 0.0 ? 0.0 : std::copysign(kSurvivesTruncation, units));
    const auto motor = static_cast<std::size_t>(joint);
    command.joint_torque_Nm[joint] = units * unit_Nm;
    command.motors.joint_torque_Nm[motor] = sent * unit_Nm;
    command.motors.current_A[motor] = delta_ ? 0.0 : 1e-3 * sent;
  }
  return command;
}

Eigen::Vector3d MotorUnits::current_A(const Eigen::Vector3d& joint_torque_Nm) const noexcept {
  return delta_ ? Eigen::Vector3d::Zero()
                : Eigen::Vector3d(1e-3 * joint_torque_Nm.array() / torque_per_unit_Nm_);
}

Eigen::Vector3d MotorUnits::half_of_limits_Nm() const noexcept { return 0.5 * max_torque_Nm_; }

}  // namespace forcegrid::calibration
