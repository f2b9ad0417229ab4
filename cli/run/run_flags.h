// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "cli/common/options.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {

/// Adds the subcommand `run`, which sets `action`.
void add_run(Command& app, RunOptions& options, std::function<int()>& action);

/// Adds the subcommand `record`: `run` with a file to record to. Its configuration keys are those
/// of [run].
void add_record(Command& app, RunOptions& options, std::function<int()>& action);

}  // namespace forcegrid::cli
