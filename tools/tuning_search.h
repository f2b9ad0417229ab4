#pragma once

#include <string>

#include "evaluation/trace.h"
#include "forcegrid/core/method_options.h"
#include "tools/tuning.h"

namespace forcegrid::tools {

/// What a loop of `rate_Hz` would have met on a path that was recorded at a higher rate: the
/// instants nearest to its cycles, with all samples and contacts.
evaluation::Trace at_rate(const evaluation::Trace& trace, double rate_Hz);

/// [N/m] The largest stiffness that the samples of a path tell, over all directions; NaN where no
/// sample has one.
double stiffest_N_per_m(const evaluation::Trace& trace);

/// Plays a path to a row's method, with the row's rate and fill budget, and fills in what that
/// came to. A method that can't be made, or that needs more than a path can give, gets a `problem`.
/// Real-time: no. Threads: one; what it takes of the processor is measured.
void judge_on_path(const evaluation::Trace& trace, const MethodOptions& base, TuningRow& row);

/// The loop in which the margin is looked for: see stability/closed_loop.h, the device of its
/// charts.
struct MarginLoop {
  std::string hand = "firm";   ///< of stability::hands()
  int frame_period_us = 1000;  ///< of the device's bus: counts and forces are late by it
  double simulator_rate_Hz = 30.0;
  double stiffest_N_per_m = 0.0;  ///< > 0
};

/// The largest stiffness of a spring up to which the row's method and rate are stable in simulated
/// time, over `loop.stiffest_N_per_m`; 1 is the edge.
/// Real-time: no; a second or two for a method of 20 us a cycle.
/// @throws std::invalid_argument for a method or hand that is not known.
double stability_margin(const MarginLoop& loop, const MethodOptions& base, const TuningRow& row);

}  // namespace forcegrid::tools
