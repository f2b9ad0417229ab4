// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/charts/chart_support.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

/// Options of `forcegrid chart two-tools`; an empty list selects the chart's own.
struct ChartTwoToolsOptions : ChartChoice {
  std::vector<std::string> scenes;
  std::vector<std::string> pairs;
  std::vector<std::string> methods;
  std::vector<std::string> objects;  ///< of the closed loop
  std::vector<std::string> parts;    ///< errors, stability
  std::string goals_for;
  double seconds = 10.0;
  double delay_ms = 0.0;
  double noise_mN = 0.0;
  bool stiffness = false;  ///< of the samples
};

/// Adds the subcommand `two-tools` to `chart`.
void add_chart_two_tools(Command& chart, ChartTwoToolsOptions& options,
                         std::function<int()>& action);

/// Solves two tools on one object, writes the traces, evaluates methods on them, and searches for
/// the largest stable stiffness in the closed loop of two hands; see docs/two_tools.md. Result and
/// errors are those of chart_accuracy_command(), but a search that is stopped keeps nothing.
int chart_two_tools_command(const ChartTwoToolsOptions& asked);

}  // namespace forcegrid::cli
