// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "evaluation/traces/pair_trace.h"

namespace forcegrid::testing {

/// Two tools that move at constant velocity on a linear object, so that what every simple method
/// does can be worked out by hand: F = -K (P - P_0), K a symmetric stiffness over both.
struct PairRamp {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;

  static constexpr double kServoPeriod_s = 0.002;
  static constexpr int kCyclesPerSample = 10;  ///< a sample each 20 ms, delivered 20 ms later
  double seconds = 2.0;
  PairVector start_W = (PairVector() << 0.05, 0.04, 0.05, 0.05, 0.08, 0.05).finished();
  PairVector velocity_W = (PairVector() << 0.03, 0.0, 0.0, -0.01, 0.02, 0.0).finished();
  Matrix6 stiffness_N_per_m = coupled(100.0, 30.0);

  /// `own` of each tool in every direction, `between` them along equal axes.
  static Matrix6 coupled(double own_N_per_m, double between_N_per_m) {
    Matrix6 k = own_N_per_m * Matrix6::Identity();
    k.topRightCorner<3, 3>() = -between_N_per_m * Eigen::Matrix3d::Identity();
    k.bottomLeftCorner<3, 3>() = -between_N_per_m * Eigen::Matrix3d::Identity();
    return k;
  }

  double time_s(int cycle) const { return cycle * kServoPeriod_s; }
  int cycles() const { return static_cast<int>(std::lround(seconds / kServoPeriod_s)); }
  PairVector positions_W(int cycle) const { return start_W + time_s(cycle) * velocity_W; }
  PairVector forces_W(int cycle) const {
    return -stiffness_N_per_m * (positions_W(cycle) - start_W);
  }

  evaluation::PairTrace trace() const {
    evaluation::PairTrace trace;
    for (int cycle = 0; cycle < cycles(); ++cycle) {
      trace.servo.push_back({time_s(cycle), positions_W(cycle), forces_W(cycle)});
      if (cycle % kCyclesPerSample == 0) {
        evaluation::DeliveredPairSample row;
        row.sample.time_s = time_s(cycle);
        row.sample.positions_W = positions_W(cycle);
        row.sample.forces_W = forces_W(cycle);
        row.delivered_s = time_s(cycle + kCyclesPerSample);
        trace.samples.push_back(row);
      }
    }
    return trace;
  }
};

}  // namespace forcegrid::testing
