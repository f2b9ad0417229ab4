// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace forcegrid::cli {

/// Accepts a scene by its name, or a TOML file.
CLI::Validator scene_check();

/// Describes the values of --scene, for its help.
std::string scene_help();

}  // namespace forcegrid::cli
