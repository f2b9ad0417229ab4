// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/run/run_command.h"

namespace forcegrid::cli {

/// Returns the options of the run that goes on with another scene. --material-tolerance-percent was
/// given for the first one: the next is simulated as written, and the log says so.
RunOptions with_scene(RunOptions options, const std::string& scene);

}  // namespace forcegrid::cli
