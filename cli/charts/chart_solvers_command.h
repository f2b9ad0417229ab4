// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "simulator/bench/solver_scaling.h"

namespace forcegrid::cli {

/// Options of `forcegrid chart solvers`.
struct ChartSolversOptions {
  std::string out;
  std::vector<int> sizes{1'000, 10'000, 100'000};  ///< vertices
  /// Of the default ones, those whose mesh is missing are left out with a line that says why.
  std::vector<std::string> scenes = simulator::SolverScalingOptions{}.scenes;
  bool quick = false;
};

/// Adds the subcommand `solvers` to `chart`.
void add_chart_solvers(Command& chart, ChartSolversOptions& options, std::function<int()>& action);

/// Measures the cost of a servo cycle with each solver; see docs/solvers.md. Result and errors are
/// those of chart_accuracy_command().
int chart_solvers_command(const ChartSolversOptions& asked);

}  // namespace forcegrid::cli
