#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace forcegrid::cli {

/// Takes a scene by its name, or a TOML file.
CLI::Validator scene_check();

/// What --scene may be, for its help.
std::string scene_help();

}  // namespace forcegrid::cli
