// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/common/options.h"

namespace forcegrid::cli {

/// Accepts a scene by its name, or a TOML file.
Check scene_check();

/// Describes the values of --scene, for its help.
std::string scene_help();

}  // namespace forcegrid::cli
