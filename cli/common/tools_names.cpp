// SPDX-License-Identifier: Apache-2.0
#include "cli/common/tools_names.h"

#include <algorithm>
#include <array>
#include <stdexcept>

namespace forcegrid::cli {
namespace {

constexpr std::array<ToolsCommand, 9> kCommands = {{
    {"calibrate",
     "Home a device, check its directions and range, measure its friction and torque constants, "
     "and "
     "write a profile for this unit"},
    {"tune", "Find the cheapest rate, fill budget and method that are good enough here"},
    {"replay",
     "Let the emulated hand repeat a recording's path, with the same or another method.\n"
     "(Into a method alone: forcegrid evaluate --trace FILE.h5; into pictures: forcegrid plot)"},
    {"plot", "Draw the standard pictures of a recording"},
    {"evaluate", "Evaluate force methods on a recorded trace; prints JSON"},
    {"chart", "Chart force methods against each other"},
    {"paper", "Repeat the experiments of the forcegrid paper beside its claims"},
    {"completion", "Print a script that completes commands and options in a shell"},
    {"man-pages", "Write the manual pages of all commands"},
}};

const ToolsCommand* find(const std::string& name) {
  const auto found = std::find_if(kCommands.begin(), kCommands.end(),
                                  [&](const ToolsCommand& one) { return one.name == name; });
  return found == kCommands.end() ? nullptr : &*found;
}

}  // namespace

std::span<const ToolsCommand> tools_commands() { return kCommands; }

bool is_tools_command(const std::string& name) { return find(name) != nullptr; }

std::string tools_description(const std::string& name) {
  const ToolsCommand* const command = find(name);
  if (command == nullptr) {
    throw std::out_of_range("forcegrid-tools has no command " + name);
  }
  return command->description;
}

}  // namespace forcegrid::cli
