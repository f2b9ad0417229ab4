// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/common/options.h"

namespace forcegrid::cli {

/// A script that completes commands, options and their values in bash, made from the option tables.
/// It needs nothing but bash; where bash-completion is loaded, words with a colon
/// (emulated:falcon) are completed, too.
/// @param program  with all commands
std::string bash_completion(const Command& program);

/// The same for zsh, with a description of each.
std::string zsh_completion(const Command& program);

}  // namespace forcegrid::cli
