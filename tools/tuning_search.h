// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "evaluation/traces/trace.h"
#include "forcegrid/core/method_options.h"
#include "tools/tuning.h"

namespace forcegrid::tools {

/// Resamples a path that was recorded at a higher rate for a loop at `rate_Hz`: the instants
/// nearest to its cycles, with all samples and contacts.
evaluation::Trace at_rate(const evaluation::Trace& trace, double rate_Hz);

/// [N/m] Largest stiffness of a path's samples over all directions; NaN if no sample has a
/// stiffness.
double stiffest_N_per_m(const evaluation::Trace& trace);

/// Plays a path to a row's method, with the row's rate and fill budget, and fills in error and
/// cost. A method that can't be made, or that a path can't serve, gets a `problem`.
/// Real-time: no. Threads: one; its processor time is measured.
void judge_on_path(const evaluation::Trace& trace, const MethodOptions& base, TuningRow& row);

/// The simulated loop for the stability margin, with the device of the stability charts; see
/// stability/closed_loop.h.
struct MarginLoop {
  std::string hand = "firm";   ///< of stability::hands()
  int frame_period_us = 1000;  ///< of the device's bus: the delay of counts and forces
  double simulator_rate_Hz = 30.0;
  double stiffest_N_per_m = 0.0;  ///< > 0
};

/// Returns the largest stiffness of a spring at which the row's method and rate are stable in
/// simulated time, over `loop.stiffest_N_per_m`. Values below 1 are unstable on the path.
/// Real-time: no. Takes one to two seconds for a method of 20 us per cycle.
/// @throws std::invalid_argument for an unknown method or hand.
double stability_margin(const MarginLoop& loop, const MethodOptions& base, const TuningRow& row);

}  // namespace forcegrid::tools
