// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/charts/chart_solvers_command.h"
#include "cli/charts/chart_stability_command.h"
#include "cli/charts/chart_support.h"
#include "cli/charts/chart_two_tools_command.h"
#include "cli/charts/chart_wrist_command.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

/// Options of `forcegrid chart accuracy`; an empty list selects everything.
struct ChartAccuracyOptions : ShardedChoice {
  std::vector<std::string> scenes;
  std::vector<std::string> trajectories;
  std::vector<std::string> conditions;
  std::vector<std::string> methods;  ///< MethodVariant texts, or direct
  std::string goals_for;             ///< method compared with the goals; empty: that of `run`
  std::vector<std::string> figures;  ///< SCENE/TRAJECTORY/CONDITION
  std::vector<std::string> figure_methods;  ///< empty: the default method, forcegrid, hold
  bool no_stiffness_picture = false;
};

struct ChartCommandOptions {
  ChartAccuracyOptions accuracy;
  ChartSolversOptions solvers;
  ChartWristOptions wrist;
  ChartStabilityOptions stability;
  ChartTwoToolsOptions two_tools;
};

/// Adds the subcommand `chart` with its subcommands `accuracy`, `stability`, `solvers`, `two-tools`
/// and `wrist`, which set `action`.
void add_chart(Command& app, ChartCommandOptions& options, std::function<int()>& action);

/// Evaluates force methods on the chart's objects, motions and networks, and writes tables,
/// pictures and a page into `asked.out`; see docs/accuracy.md.
/// @returns the program's exit status, 0.
/// @throws std::exception with a sentence for the user.
int chart_accuracy_command(const ChartAccuracyOptions& asked);

}  // namespace forcegrid::cli
