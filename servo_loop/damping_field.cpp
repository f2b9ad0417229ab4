// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/damping_field.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "servo_loop/dead_band.h"

namespace forcegrid::servo {

DampingField::DampingField(const DampingFieldOptions& options) : options_(options) {
  const auto usable = [](double value) { return value >= 0.0 && std::isfinite(value); };
  if (!usable(options.damping_N_s_per_m) || !usable(options.max_force_N) ||
      !usable(options.dead_band_counts) || !usable(options.velocity_time_constant_s) ||
      options.velocity_time_constant_s == 0.0) {
    throw std::invalid_argument(
        "damping field: damping, largest force and dead band must not be negative, the velocity's "
        "time constant positive");
  }
}

Eigen::Vector3d DampingField::force_W(const Eigen::Vector3d& velocity_W,
                                      const Eigen::Vector3d& resolution_W_m) const noexcept {
  const Eigen::Vector3d motion_W = without_trembling_counts(
      velocity_W, resolution_W_m, options_.dead_band_counts, options_.velocity_time_constant_s);
  const double speed_m_per_s = motion_W.norm();
  if (!(speed_m_per_s > 0.0) || !std::isfinite(speed_m_per_s)) {
    return Eigen::Vector3d::Zero();
  }
  const double force_N = std::min(options_.damping_N_s_per_m * speed_m_per_s, options_.max_force_N);
  return -force_N / speed_m_per_s * motion_W;
}

}  // namespace forcegrid::servo
