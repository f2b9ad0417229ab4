// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "cli/common/json_target.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

/// Charts, the paper's experiments, calibration and tuning are half of what has to be compiled, and
/// a run needs nothing of it. They are in the program forcegrid-tools, which has all commands;
/// `forcegrid` has the others and becomes forcegrid-tools for these. The functions below are
/// defined twice, in tools_elsewhere.cpp for `forcegrid` and in tools_commands.cpp for
/// forcegrid-tools. cli/common/tools_names.h has the names of its commands.

/// Whether this is forcegrid-tools.
bool has_tools_commands();

/// Adds these commands, in `forcegrid` only for its help.
/// @returns their options, which have to live as long as the program.
std::shared_ptr<void> add_tools_commands(Command& program, std::function<int()>& action);

/// In `forcegrid`, if the command line asks for something that only forcegrid-tools has, becomes
/// that program, with the same arguments. In a build folder that has none yet it is built first.
/// @returns the exit status if that can't be done; nothing: go on here.
std::optional<int> become_tools_program(int argc, char** argv);

/// `simulate --bench`. @throws std::exception with a sentence for the user.
int bench_command(const std::string& scene, const JsonTarget& json);

}  // namespace forcegrid::cli
