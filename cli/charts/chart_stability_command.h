#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/charts/chart_support.h"

namespace CLI {
class App;
}

namespace forcegrid::cli {

/// What `forcegrid chart stability` was asked for.
struct ChartStabilityOptions : ChartChoice {
  std::vector<std::string> methods;  ///< MethodVariant texts; empty: those of the chart
  std::vector<std::string> parts;    ///< empty: all
  std::vector<std::string> hands;    ///< empty: all
  std::string goals_for;             ///< as ChartAccuracyOptions::goals_for
};

/// Adds the subcommand `stability` to `chart`.
void add_chart_stability(CLI::App& chart, ChartStabilityOptions& options,
                         std::function<int()>& action);

/// Closes the loop over force methods in simulated time, see docs/stability.md; as
/// chart_accuracy_command().
int chart_stability_command(const ChartStabilityOptions& options);

}  // namespace forcegrid::cli
