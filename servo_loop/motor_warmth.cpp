// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/motor_warmth.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::servo {
namespace {

Eigen::Array3d array(const std::array<double, 3>& values) noexcept {
  return Eigen::Array3d(values[0], values[1], values[2]);
}

}  // namespace

MotorWarmth::MotorWarmth(const profiles::DeviceProfile& profile) noexcept
    : known_(profile.kind != profiles::DeviceKind::kDelta),
      peak_A_(array(profile.motors.max_current_A)),
      continuous_A_(array(profile.motors.continuous_current_A)),
      time_constant_s_(profile.motors.thermal_time_constant_s) {}

double MotorWarmth::scale(const std::array<double, 3>& current_A) const noexcept {
  if (!known_) {
    return 1.0;
  }
  const Eigen::Array3d warmth = theta_A2_ / continuous_A_.square();
  const Eigen::Array3d cold = ((1.0 - warmth) / (1.0 - kFull)).min(1.0).max(0.0);
  const Eigen::Array3d allowed_A = continuous_A_ + cold * (peak_A_ - continuous_A_);
  const double excess = (array(current_A).abs() / allowed_A).maxCoeff();
  return excess > 1.0 ? 1.0 / excess : 1.0;
}

void MotorWarmth::advance(double elapsed_s, const std::array<double, 3>& current_A) noexcept {
  if (!known_ || !(elapsed_s > 0.0) || !std::isfinite(elapsed_s) || !array(current_A).allFinite()) {
    return;
  }
  const double share = 1.0 - std::exp(-elapsed_s / time_constant_s_);
  theta_A2_ += share * (array(current_A).square() - theta_A2_);
}

double MotorWarmth::warmest() const noexcept {
  return known_ ? (theta_A2_ / continuous_A_.square()).maxCoeff() : 0.0;
}

}  // namespace forcegrid::servo
