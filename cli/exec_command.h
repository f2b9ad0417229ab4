// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/common/options.h"

namespace forcegrid::cli {

struct ExecOptions {
  std::vector<std::string> command;  ///< a program and its arguments
  std::string device;                ///< FORCEGRID_DEVICE; empty: as it is
};

/// What stands behind `exec ... --` belongs to the other program: nobody here may read it.
/// @param argc loses these words and the "--". @returns them; empty if this is no `exec`.
std::vector<std::string> take_command_of_exec(int& argc, const char* const* argv);

/// Adds the subcommand, which sets `action`.
void add_exec(Command& app, ExecOptions& options, std::function<int()>& action);

/// Becomes the program, which then finds libHD.so and libhdPhantom.so of this installation first.
/// @returns only if it can't: 126 if the program can't be run, 127 if there is none.
/// @throws std::runtime_error if the libraries are not installed.
int exec_command(const ExecOptions& options);

}  // namespace forcegrid::cli
