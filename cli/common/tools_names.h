// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

namespace forcegrid::cli {

/// A command that only forcegrid-tools has.
struct ToolsCommand {
  const char* name;
  const char* description;
};

std::span<const ToolsCommand> tools_commands();
bool is_tools_command(const std::string& name);
/// @throws std::out_of_range if it is none of them.
std::string tools_description(const std::string& name);

}  // namespace forcegrid::cli
