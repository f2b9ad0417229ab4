// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <random>

#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::testing {

/// Closed-form objects under two tools, and positions to try them at.

/// Two springs to the ground and one between the tools, the same in every direction:
///   F_1 = -a P_1 - c (P_1 - P_2),   F_2 = -b P_2 - c (P_2 - P_1)
struct SeriesSprings {
  double a_N_per_m = 100.0;
  double b_N_per_m = 150.0;
  double c_N_per_m = 60.0;

  PairVector forces_N(const PairVector& p_m) const {
    const Eigen::Vector3d between_N = c_N_per_m * (p_m.head<3>() - p_m.tail<3>());
    PairVector f;
    f << -a_N_per_m * p_m.head<3>() - between_N, -b_N_per_m * p_m.tail<3>() + between_N;
    return f;
  }
  PairMatrix stiffness_N_per_m() const {
    const Eigen::Matrix3d one = Eigen::Matrix3d::Identity();
    PairMatrix j;
    j << -(a_N_per_m + c_N_per_m) * one, c_N_per_m * one,  //
        c_N_per_m * one, -(b_N_per_m + c_N_per_m) * one;
    return j;
  }
};

/// A smooth hardening object: U = 1/2 p.Kp + g/4 (|P_1 - P_2|^2 + |P_1|^2 + |P_2|^2)^2.
struct HardeningPair {
  SeriesSprings springs;
  double g_N_per_m3 = 1e5;

  PairVector forces_N(const PairVector& p_m) const {
    const Eigen::Vector3d apart = p_m.head<3>() - p_m.tail<3>();
    const double s = apart.squaredNorm() + p_m.squaredNorm();
    PairVector gradient;
    gradient << p_m.head<3>() + apart, p_m.tail<3>() - apart;
    return springs.forces_N(p_m) - g_N_per_m3 * s * gradient;
  }
  PairMatrix stiffness_N_per_m(const PairVector& p_m) const {
    const Eigen::Vector3d apart = p_m.head<3>() - p_m.tail<3>();
    const double s = apart.squaredNorm() + p_m.squaredNorm();
    PairVector gradient;
    gradient << p_m.head<3>() + apart, p_m.tail<3>() - apart;
    const SeriesSprings unit{1.0, 1.0, 1.0};  // d(gradient)/dp = -its stiffness
    return springs.stiffness_N_per_m() +
           g_N_per_m3 * (s * unit.stiffness_N_per_m() - 2.0 * gradient * gradient.transpose());
  }
};

/// Uniform in a cube of +-`reach_m` for each coordinate.
class RandomPositions {
 public:
  RandomPositions(unsigned seed, double reach_m) : numbers_(seed), coordinate_(-reach_m, reach_m) {}
  PairVector next() {
    PairVector p;
    for (double& x : p) {
      x = coordinate_(numbers_);
    }
    return p;
  }

 private:
  std::mt19937 numbers_;
  std::uniform_real_distribution<double> coordinate_;
};

}  // namespace forcegrid::testing
