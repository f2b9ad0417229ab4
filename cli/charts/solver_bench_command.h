// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/run/run_command.h"

namespace forcegrid::cli {

/// Measures every solver on the scene along the motion `random` (simulator::bench_solvers) and
/// prints tables, or writes JSON to the target `json`. Progress goes to standard error.
/// @returns the program's exit status, 0.
int solver_bench_command(const std::string& scene, const JsonTarget& json);

}  // namespace forcegrid::cli
