#pragma once

#include <string>

#include "cli/run/run_command.h"

namespace forcegrid::cli {

/// Measures every solver on the scene (simulator::bench_solvers) along the motion `random` and
/// prints the tables, or as JSON where `json` says. What is being measured goes to standard error.
int solver_bench_command(const std::string& scene, const JsonTarget& json);

}  // namespace forcegrid::cli
