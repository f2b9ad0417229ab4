// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "evaluation/error_figures.h"
#include "evaluation/pair_trace.h"
#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::evaluation {

struct PairJudgeOptions {
  /// Units of work() per servo cycle; negative: all pending work at once, which is timed as the
  /// cost of the sample.
  int work_budget = -1;
  bool keep_forces = false;  ///< fill PairVerdict::forces_W
};

/// Errors of one tool's force, or of both together. Percentages refer to the RMS of the reference's
/// magnitude over the whole trace; "after" starts one second after the first servo instant.
struct PairErrors {
  double reference_rms_N = 0.0;
  ErrorFigures first_1s;
  ErrorFigures after_1s;
  double adaptation_s = 0.0;    ///< see adaptation_s() in error_figures.h
  double largest_step_N = 0.0;  ///< of the error between two cycles, after 1 s; NaN: none
};

/// Errors and costs of a method on a trace of two tools. A figure is NaN if there is nothing to
/// measure.
struct PairVerdict {
  PairErrors together;  ///< of (F_1, F_2) as one vector
  std::array<PairErrors, 2> tools;
  double query_ns_median = 0.0;  ///< forces(), for both tools
  double query_ns_p99 = 0.0;
  double sample_us_median = 0.0;  ///< take_sample() and the work() that it caused
  double sample_us_p99 = 0.0;
  double cycle_ns = 0.0;  ///< mean time per cycle in the method, samples included
  double cycle_ns_median = 0.0;
  double cycle_ns_p99 = 0.0;
  double cycle_ns_p999 = 0.0;
  double timer_floor_ns = 0.0;  ///< no time is reported below it; a query not below an eighth of it
  std::size_t memory_bytes = 0;
  std::size_t samples_taken = 0;
  std::size_t samples_not_taken = 0;              ///< of an earlier contact
  std::array<std::size_t, 5> cycles_by_status{};  ///< indexed by EstimateStatus
  std::vector<PairVector> forces_W;               ///< [N] at each servo instant
};

/// Plays a trace of two tools to a new method in the order of a servo that renders both: at each
/// servo instant everything delivered by then, observe(), forces(), work(). The method never
/// receives the reference forces. Errors and times are those of judge() for one tool; samples
/// reach the method without a SampleGate, which knows one tool's forces.
/// Real-time: no. Threads: one.
PairVerdict judge_pair(PairForceMethod& method, const PairTrace& trace,
                       const PairJudgeOptions& options = {});

}  // namespace forcegrid::evaluation
