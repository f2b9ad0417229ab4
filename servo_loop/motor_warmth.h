#pragma once

#include <Eigen/Core>
#include <array>

#include "profiles/device_profile.h"

namespace forcegrid::servo {

/// Keeps motors from getting too warm. A winding's temperature follows its copper losses, so that
///
///   d(theta)/dt = (I^2 - theta) / tau
///
/// with theta = I_c^2 as the temperature of the continuous current I_c, and tau the profile's
/// thermal time constant. A cold motor may have its peak current I_p; from theta = kFull I_c^2 on
/// the allowed current falls from I_p to I_c, linearly in theta, and reaches I_c with it: a motor
/// that is pushed for ever settles at I_c. From cold, I_p lasts some kFull tau (I_c / I_p)^2.
/// A device whose currents are in no source (a delta) is left alone.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class MotorWarmth {
 public:
  static constexpr double kFull = 0.8;

  explicit MotorWarmth(const profiles::DeviceProfile& profile) noexcept;

  /// By how much all three currents have to be scaled so that none is above what its motor may
  /// have, 0..1: the force keeps its direction.
  [[nodiscard]] double scale(const std::array<double, 3>& current_A) const noexcept;

  /// `current_A` has flowed for `elapsed_s`. A current or time that is not finite is not counted.
  void advance(double elapsed_s, const std::array<double, 3>& current_A) noexcept;

  /// theta / I_c^2 of the warmest motor: 0 cold, 1 as warm as the continuous current makes it.
  double warmest() const noexcept;
  /// Whether a motor may have less than its peak current now.
  bool limits() const noexcept { return warmest() > kFull; }

 private:
  bool known_;
  Eigen::Array3d peak_A_, continuous_A_;
  double time_constant_s_;
  Eigen::Array3d theta_A2_ = Eigen::Array3d::Zero();
};

}  // namespace forcegrid::servo
