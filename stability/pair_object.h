// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::stability {

/// An object under two tools in closed form: a hardening spring from each tool to the ground and
/// one between them, the same in every direction. With d_i the tools' displacements,
///
///   F_1 = -s(|d_1|) d_1 - c s(|d_1 - d_2|) (d_1 - d_2),   s(r) = K' (1 + (r/a)^2)
///
/// and F_2 likewise; c = kBetween. K' is chosen so that K = K' (1 + c) is the stiffness that a tool
/// feels at rest while the other one stands still. When both move against each other it is K' (1 +
/// 2c), when they move together K'. The forces are the gradient
/// of one energy.
class SpringPair {
 public:
  static constexpr double kBetween = 0.5;
  static constexpr double kHardens_m = 0.020;

  /// @param stiffness_N_per_m K. @param hardens_m a; infinite: linear springs.
  explicit SpringPair(double stiffness_N_per_m, double hardens_m = kHardens_m)
      : spring_N_per_m_(stiffness_N_per_m / (1.0 + kBetween)),
        hardening_per_m2_(1.0 / (hardens_m * hardens_m)) {}

  /// [N] On both tools. @param displacements_m of both from where they touched.
  PairVector forces_N(const PairVector& displacements_m) const {
    const Eigen::Vector3d first = displacements_m.head<3>();
    const Eigen::Vector3d second = displacements_m.tail<3>();
    const Eigen::Vector3d between_N = kBetween * pull_N(first - second);
    PairVector forces;
    forces << pull_N(first) + between_N, pull_N(second) - between_N;
    return forces;
  }

 private:
  Eigen::Vector3d pull_N(const Eigen::Vector3d& d_m) const {
    return -spring_N_per_m_ * (1.0 + hardening_per_m2_ * d_m.squaredNorm()) * d_m;
  }

  double spring_N_per_m_;
  double hardening_per_m2_;
};

}  // namespace forcegrid::stability
