// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string>

#include "evaluation/traces/trace.h"

namespace forcegrid::testing {

/// A tool that moves at constant speed along x against a linear spring, so that what every simple
/// method does can be worked out by hand.
struct Ramp {
  static constexpr double kSpeed_m_per_s = 0.05;
  static constexpr double kServoPeriod_s = 0.002;
  static constexpr int kCyclesPerSample = 10;  ///< a sample each 20 ms, delivered 20 ms later
  double stiffness_N_per_m = 100.0;
  double seconds = 2.0;
  bool send_stiffness = true;
  Eigen::Vector3d start_W = Eigen::Vector3d(0.05, 0.06, 0.06);

  double time_s(int cycle) const { return cycle * kServoPeriod_s; }
  int cycles() const { return static_cast<int>(std::lround(seconds / kServoPeriod_s)); }
  Eigen::Vector3d position_W(int cycle) const {
    return start_W + Eigen::Vector3d(kSpeed_m_per_s * time_s(cycle), 0.0, 0.0);
  }
  Eigen::Vector3d force_W(int cycle) const {
    return -stiffness_N_per_m * (position_W(cycle) - start_W);
  }

  evaluation::Trace trace() const {
    evaluation::Trace trace;
    for (int cycle = 0; cycle < cycles(); ++cycle) {
      trace.servo.push_back({time_s(cycle), position_W(cycle), force_W(cycle)});
      if (cycle % kCyclesPerSample == 0) {
        evaluation::DeliveredSample row;
        row.sample.time_s = time_s(cycle);
        row.sample.position_W = position_W(cycle);
        row.sample.force_W = force_W(cycle);
        row.sample.has_stiffness = send_stiffness;
        if (send_stiffness) {
          row.sample.stiffness_W = -stiffness_N_per_m * Eigen::Matrix3d::Identity();
        }
        row.delivered_s = time_s(cycle + kCyclesPerSample);
        trace.samples.push_back(row);
      }
    }
    return trace;
  }
};

}  // namespace forcegrid::testing
