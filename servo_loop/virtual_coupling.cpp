// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/virtual_coupling.h"

#include <cmath>
#include <stdexcept>

namespace forcegrid::servo {

VirtualCoupling::VirtualCoupling(const CouplingOptions& options) : options_(options) {
  if (!(options.stiffness_N_per_m > 0.0) || !std::isfinite(options.stiffness_N_per_m) ||
      !(options.damping_N_s_per_m > 0.0) || !std::isfinite(options.damping_N_s_per_m)) {
    throw std::invalid_argument("virtual coupling: stiffness and damping must be positive");
  }
}

void VirtualCoupling::advance(double dt_s, const Eigen::Vector3d& force_W) noexcept {
  if (!force_W.allFinite() || !(dt_s > 0.0) || !std::isfinite(dt_s)) {
    return;
  }
  deflection_W_ = (deflection_W_ + dt_s / options_.damping_N_s_per_m * force_W) /
                  (1.0 + dt_s * options_.stiffness_N_per_m / options_.damping_N_s_per_m);
}

}  // namespace forcegrid::servo
