// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "cli/common/json_target.h"

namespace forcegrid::cli {

/// Helpers that the options of several commands share.

/// Joins words with commas: "a, b, c".
std::string joined(const std::vector<std::string>& words);

/// Names of the emulated hand's motions, of the emulated hands, and of the orders in which reports
/// cross the emulated bus.
const std::vector<std::string>& motions();
const std::vector<std::string>& hands();
const std::vector<std::string>& frame_orders();

/// Accepts a motion by its name, or path:FILE.
CLI::Validator motion_check();
/// Accepts a method's name with valid options, or "direct".
CLI::Validator method_check();
/// Accepts a fault of an emulated device; see emulator::parse_fault().
CLI::Validator fault_check();

/// Adds `--json [FILE]`.
void add_json(CLI::App& command, JsonTarget& target);
/// Adds `--key FILE`, which both ends of the link take. It names a file because a key on the
/// command line would be visible to other users.
void add_key(CLI::App& command, std::vector<std::string>& files, const std::string& description);

}  // namespace forcegrid::cli
