#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "cli/common/json_target.h"

namespace forcegrid::cli {

/// What several commands' options have in common.

/// "a, b, c".
std::string joined(const std::vector<std::string>& words);

/// Names of the emulated hand's motions, of who holds the arm, and of the order in which reports
/// cross the emulated bus.
const std::vector<std::string>& motions();
const std::vector<std::string>& hands();
const std::vector<std::string>& frame_orders();

/// A motion by its name, or path:FILE.
CLI::Validator motion_check();
/// A method's name with options that can be understood, or "direct".
CLI::Validator method_check();
/// What an emulated device shall do wrong, see emulator::parse_fault().
CLI::Validator fault_check();

/// `--json [FILE]`.
void add_json(CLI::App& command, JsonTarget& target);
/// `--key FILE` of both ends of the link: the file's name, as what is in it is for no command line.
void add_key(CLI::App& command, std::vector<std::string>& files, const std::string& description);

}  // namespace forcegrid::cli
