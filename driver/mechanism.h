// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// A device's linkage as the servo loop sees it, whatever its kind: encoder counts to the tip in
/// the device frame D (x toward the user, y to the user's right, z up), with the Jacobian
/// d(position_D)/dq that also maps forces to joint torques, tau = J^T F.
/// Real-time: every function is bounded and neither allocates, locks nor throws.
/// Threads: one; an implementation may begin at its last pose.
class Mechanism {
 public:
  virtual ~Mechanism() = default;

  /// Forward kinematics and Jacobian of a report's counters; with a wrist the tool's orientation,
  /// too.
  [[nodiscard]] virtual ArmPose forward(const std::array<std::int32_t, 6>& counts) noexcept = 0;

  /// Joint torque [Nm] that holds the links' weight at these joint angles; zero for a delta, whose
  /// profile has no masses.
  [[nodiscard]] virtual Eigen::Vector3d gravity_torque(
      const Eigen::Vector3d& joint_angle_rad) const noexcept = 0;
};

/// The linkage that `profile` describes. Real-time: no. Threads: any.
std::unique_ptr<Mechanism> make_mechanism(const profiles::DeviceProfile& profile);

#pragma GCC visibility pop
}  // namespace forcegrid::driver
