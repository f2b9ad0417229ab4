// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::calibration {

/// Joint torques as a device's report can carry them: whole milliamperes, or whole motor commands
/// of a delta. The identification needs the current that flowed, so it must know the rounding.
///
/// Real-time: no allocation, lock or throw. Threads: const functions from any.
class MotorUnits {
 public:
  explicit MotorUnits(const profiles::DeviceProfile& profile) noexcept;

  struct Command {
    driver::MotorCommand motors;
    /// The torque by the profile's torque constants.
    Eigen::Vector3d joint_torque_Nm = Eigen::Vector3d::Zero();
  };
  /// The nearest command to `joint_torque_Nm`, each joint within +-`limit_Nm`.
  [[nodiscard]] Command nearest(const Eigen::Vector3d& joint_torque_Nm,
                                const Eigen::Vector3d& limit_Nm) const noexcept;

  /// [A] for a joint torque; zero for a delta, whose currents no source states.
  [[nodiscard]] Eigen::Vector3d current_A(const Eigen::Vector3d& joint_torque_Nm) const noexcept;

  /// Half of the profile's limits for a joint: of its torque and of its motor's current.
  [[nodiscard]] Eigen::Vector3d half_of_limits_Nm() const noexcept;

 private:
  bool delta_;
  Eigen::Array3d torque_per_unit_Nm_;  ///< signed: of 1 mA, or of one motor command
  Eigen::Array3d max_torque_Nm_;
};

}  // namespace forcegrid::calibration
