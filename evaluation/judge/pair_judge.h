// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "evaluation/judge/error_figures.h"
#include "evaluation/judge/method_costs.h"
#include "evaluation/traces/pair_trace.h"
#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::evaluation {

struct PairJudgeOptions {
  /// Units of work() per servo cycle; negative: all pending work at once, which is timed as the
  /// cost of the sample.
  int work_budget = -1;
  bool stiffness_to_method = true;
  bool keep_forces = false;  ///< fill PairVerdict::forces_W
};

/// Errors and costs of a method on a trace of two tools. A figure is NaN if there is nothing to
/// measure.
struct PairVerdict : MethodCosts {
  ForceErrors together;  ///< of (F_1, F_2) as one vector
  std::array<ForceErrors, 2> tools;
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
