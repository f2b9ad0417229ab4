// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/common/budget_option.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

/// Options of `forcegrid evaluate`. Texts are written as in MethodVariant; empty: the default.
struct EvaluateOptions {
  std::vector<std::string> methods;  ///< MethodVariant
  std::string trace;
  std::vector<double> workspace_m;  ///< x0,y0,z0,x1,y1,z1; empty: chosen from the trace
  std::string cells = "49,49,49";
  std::string radius;  ///< metres, or a length with its unit
  std::string unit;
  std::string weight;
  std::string ridge;
  std::string samples_per_cell;
  std::string nugget;
  BudgetOption budget;
  bool no_stiffness = false;
  std::string out;
};

/// Adds the subcommand, which sets `action`.
void add_evaluate(Command& app, EvaluateOptions& options, std::function<int()>& action);

/// Evaluates force methods on a recorded trace and prints the figures as JSON; see docs/traces.md.
/// @returns the program's exit status: 0, or 2 for a request that can't be fulfilled.
/// @throws evaluation::TraceError if the trace can't be read or used.
int evaluate_command(const EvaluateOptions& options);

}  // namespace forcegrid::cli
