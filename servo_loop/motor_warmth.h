// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

#include "profiles/device_profile.h"

namespace forcegrid::servo {

/// Keeps motors from overheating. A winding's temperature follows its copper losses, so
///
///   d(theta)/dt = (I^2 - theta) / tau
///
/// with tau the profile's thermal time constant; theta = I_c^2 is the temperature that the
/// continuous current I_c gives. A cold motor may have its peak current I_p. From theta = kFull
/// I_c^2 on, the allowed current falls linearly in theta from I_p to I_c, which it reaches at theta
/// = I_c^2, so a motor that pushes without end settles at I_c. From cold, I_p lasts about
/// kFull tau (I_c / I_p)^2. A delta is not limited: no source states its currents.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class MotorWarmth {
 public:
  static constexpr double kFull = 0.8;

  explicit MotorWarmth(const profiles::DeviceProfile& profile) noexcept;

  /// The factor, 0..1, that brings all three currents within what their motors may have. One
  /// factor for all, so the force keeps its direction.
  [[nodiscard]] double scale(const std::array<double, 3>& current_A) const noexcept;

  /// `current_A` has flowed for `elapsed_s`. Ignores a current or time that is not finite.
  void advance(double elapsed_s, const std::array<double, 3>& current_A) noexcept;

  /// theta / I_c^2 of the warmest motor: 0 cold, 1 as warm as the continuous current makes it.
  double warmest() const noexcept;
  /// Whether some motor may have less than its peak current.
  bool limits() const noexcept { return warmest() > kFull; }

 private:
  bool known_;
  Eigen::Array3d peak_A_, continuous_A_;
  double time_constant_s_;
  Eigen::Array3d theta_A2_ = Eigen::Array3d::Zero();
};

}  // namespace forcegrid::servo
