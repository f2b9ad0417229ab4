// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::calibration {

/// Joint torques as a device's report can carry them: whole milliamperes, or whole motor commands
/// of a delta. What is identified is what flowed, so the rounding must be known.
///
/// Real-time: no allocation, lock or throw. Threads: const functions from any.
class MotorUnits {
 public:
  explicit MotorUnits(const profiles::DeviceProfile& profile) noexcept;

  struct Command {
    driver::MotorCommand motors;
    /// What the profile's torque constants make of it.
    Eigen::Vector3d joint_torque_Nm = Eigen::Vector3d::Zero();
  };
  /// The nearest command to `joint_torque_Nm`, each joint within +-`limit_Nm`.
  [[nodiscard]] Command nearest(const Eigen::Vector3d& joint_torque_Nm,
                                const Eigen::Vector3d& limit_Nm) const noexcept;

  /// [A] of a joint torque; zero for a delta, whose currents are in no source.
  [[nodiscard]] Eigen::Vector3d current_A(const Eigen::Vector3d& joint_torque_Nm) const noexcept;

  /// Half of what the profile allows a joint: of its torque and of its motor's current.
  [[nodiscard]] Eigen::Vector3d half_of_limits_Nm() const noexcept;

 private:
  bool delta_;
  Eigen::Array3d torque_per_unit_Nm_;  ///< signed: of 1 mA, or of one motor command
  Eigen::Array3d max_torque_Nm_;
};

}  // namespace forcegrid::calibration
