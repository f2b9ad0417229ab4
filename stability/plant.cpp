// SPDX-License-Identifier: Apache-2.0
#include "stability/plant.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <unsupported/Eigen/MatrixFunctions>

namespace forcegrid::stability {

using Eigen::Vector3d;

Plant::Plant(const DeviceDynamics& device, const Hand& hand, const Vector3d& start_W)
    : device_(device),
      mass_kg_(device.mass_kg + hand.impedance.mass_kg),
      damping_N_s_per_m_(device.damping_N_s_per_m + hand.impedance.damping_N_s_per_m),
      stiffness_N_per_m_(hand.impedance.stiffness_N_per_m),
      position_W_(start_W),
      target_W_(start_W) {
  if (!(device.mass_kg > 0.0) || !(device.damping_N_s_per_m >= 0.0) ||
      !(device.coulomb_friction_N >= 0.0) || !(device.position_step_m >= 0.0) ||
      !(hand.impedance.mass_kg >= 0.0) || !(hand.impedance.damping_N_s_per_m >= 0.0) ||
      !(hand.impedance.stiffness_N_per_m >= 0.0)) {
    throw std::invalid_argument(
        "plant: the device's mass must be positive, and its other parameters and the hand's must "
        "not be negative; the defaults are a usable device");
  }
}

const Plant::Step& Plant::step_of(std::int64_t duration_ns) {
  for (const Step& step : steps_) {
    if (step.duration_ns == duration_ns) {
      return step;
    }
  }
  // The augmented matrix [A B; 0 0] gives transition and response at once.
  Eigen::Matrix3d rates = Eigen::Matrix3d::Zero();
  rates(0, 1) = 1.0;
  rates(1, 0) = -stiffness_N_per_m_ / mass_kg_;
  rates(1, 1) = -damping_N_s_per_m_ / mass_kg_;
  rates(1, 2) = 1.0 / mass_kg_;
  const Eigen::Matrix3d both = (1e-9 * static_cast<double>(duration_ns) * rates).exp();
  steps_.push_back({duration_ns, both.topLeftCorner<2, 2>(), both.topRightCorner<2, 1>()});
  return steps_.back();
}

void Plant::linear_step(const Step& step, double duration_s, const Vector3d& motor_force_W,
                        const Vector3d& target_W, const Vector3d& target_speed_W) noexcept {
  for (Eigen::Index i = 0; i < 3; ++i) {
    const Eigen::Vector2d error(position_W_[i] - target_W_[i], velocity_W_[i] - target_speed_W[i]);
    const double input_N = motor_force_W[i] - device_.damping_N_s_per_m * target_speed_W[i];
    const Eigen::Vector2d next = step.transition * error + step.response * input_N;
    position_W_[i] = target_W[i] + next[0];
    velocity_W_[i] = target_speed_W[i] + next[1];
  }
  target_W_ = target_W;
  if (device_.coulomb_friction_N > 0.0) {
    const double speed_m_per_s = velocity_W_.norm();
    const double braked_m_per_s =
        std::min(speed_m_per_s, device_.coulomb_friction_N * duration_s / mass_kg_);
    if (speed_m_per_s > 0.0) {
      const Vector3d change_W = -braked_m_per_s / speed_m_per_s * velocity_W_;
      velocity_W_ += change_W;
      position_W_ += 0.5 * duration_s * change_W;
    }
  }
}

void Plant::advance(std::int64_t duration_ns, const Vector3d& motor_force_W,
                    const Vector3d& target_W) {
  if (duration_ns <= 0) {
    return;
  }
  // A device that nobody holds has no target.
  const Vector3d end_W = stiffness_N_per_m_ > 0.0 ? target_W : target_W_;
  const double duration_s = 1e-9 * static_cast<double>(duration_ns);
  const Vector3d target_speed_W = (end_W - target_W_) / duration_s;
  if (device_.coulomb_friction_N <= 0.0) {
    linear_step(step_of(duration_ns), duration_s, motor_force_W, end_W, target_speed_W);
    return;
  }
  const auto count = static_cast<std::int64_t>(std::ceil(duration_s / kFrictionStep_s));
  const Vector3d begin_W = target_W_;
  std::int64_t done_ns = 0;
  for (std::int64_t i = 1; i <= count; ++i) {
    const std::int64_t until_ns = i * duration_ns / count;
    const double step_s = 1e-9 * static_cast<double>(until_ns - done_ns);
    linear_step(step_of(until_ns - done_ns), step_s, motor_force_W,
                begin_W + 1e-9 * static_cast<double>(until_ns) * target_speed_W, target_speed_W);
    done_ns = until_ns;
  }
}

void Plant::flick(const Vector3d& impulse_W) noexcept { velocity_W_ += impulse_W / mass_kg_; }

Vector3d Plant::measured_W(const Vector3d& position_W) const noexcept {
  const double step_m = device_.position_step_m;
  if (step_m <= 0.0) {
    return position_W;
  }
  return (position_W.array() / step_m).round() * step_m;
}

}  // namespace forcegrid::stability
