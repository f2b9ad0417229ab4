#pragma once

#include <functional>

#include "cli/charts/chart_support.h"

namespace CLI {
class App;
}

namespace forcegrid::cli {

/// What `forcegrid paper` was asked for.
using PaperCommandOptions = ChartChoice;

/// Adds the subcommand `paper`, which sets `action`.
void add_paper(CLI::App& app, PaperCommandOptions& options, std::function<int()>& action);

/// Runs the forcegrid paper's experiments and writes them beside its figures and claims into
/// `options.out`, see docs/paper.md.
/// @returns the program's exit status, 0, also where something differs from the paper.
/// @throws std::exception with a sentence for the user.
int paper_command(const PaperCommandOptions& options);

}  // namespace forcegrid::cli
