// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "cli/charts/chart_support.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

/// Options of `forcegrid paper`.
using PaperCommandOptions = ChartChoice;

/// Adds the subcommand `paper`, which sets `action`.
void add_paper(Command& app, PaperCommandOptions& options, std::function<int()>& action);

/// Repeats the experiments of the forcegrid paper and writes the results beside the paper's figures
/// and claims into `asked.out`; see docs/paper.md.
/// @returns the program's exit status: 0, even if a result differs from the paper.
/// @throws std::exception with a sentence for the user.
int paper_command(const PaperCommandOptions& asked);

}  // namespace forcegrid::cli
