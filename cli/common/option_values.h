// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/common/json_target.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

/// Helpers that the options of several commands share.

/// Joins words with commas: "a, b, c".
std::string joined(const std::vector<std::string>& words);

/// Names of the emulated hand's motions, of the emulated hands, and of the orders in which reports
/// cross the emulated bus.
const std::vector<std::string>& motions();
const std::vector<std::string>& wrist_motions();
const std::vector<std::string>& hands();
const std::vector<std::string>& frame_orders();

/// Accepts a motion by its name, or path:FILE.
Check motion_check();
/// Accepts a method's name with valid options, or "direct".
Check method_check();
/// Accepts a fault of an emulated device; see emulator::parse_fault().
Check fault_check();

/// Adds `--json [FILE]`.
void add_json(Command& command, JsonTarget& target);
/// Adds `--key FILE`, which both ends of the link take. It names a file because a key on the
/// command line would be visible to other users.
void add_key(Command& command, std::vector<std::string>& files, const std::string& description);

}  // namespace forcegrid::cli
