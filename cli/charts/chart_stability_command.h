// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/charts/chart_support.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

/// Options of `forcegrid chart stability`.
struct ChartStabilityOptions : ShardedChoice {
  std::vector<std::string> methods;  ///< MethodVariant texts; empty: the chart's methods
  std::vector<std::string> parts;    ///< empty: all
  std::vector<std::string> hands;    ///< empty: all
  std::string goals_for;             ///< as ChartAccuracyOptions::goals_for
};

/// Adds the subcommand `stability` to `chart`.
void add_chart_stability(Command& chart, ChartStabilityOptions& options,
                         std::function<int()>& action);

/// Measures the stability of force methods in the closed loop in simulated time; see
/// docs/stability.md. Result and errors are those of chart_accuracy_command().
int chart_stability_command(const ChartStabilityOptions& asked);

}  // namespace forcegrid::cli
