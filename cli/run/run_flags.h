#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "cli/run/run_command.h"

namespace forcegrid::cli {

/// `forcegrid run`.
void add_run(CLI::App& app, RunOptions& options, std::function<int()>& action);

/// `forcegrid record`: `run` with a file to record to; its settings are those of [run].
void add_record(CLI::App& app, RunOptions& options, std::function<int()>& action);

}  // namespace forcegrid::cli
