// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// Values of --tool, --contact and the options that belong to them. The scene supplies those not
/// given.
struct ToolChoice {
  std::optional<std::string> tool;
  std::optional<std::string> contact;
  std::optional<double> radius_mm;
  std::optional<double> length_mm;
  std::optional<double> friction;
  bool turns = false;

  bool given() const { return tool || contact || radius_mm || length_mm || friction || turns; }
};

void add_tool(Command& command, ToolChoice& choice);

/// Returns a scene's tool with the requested changes.
simulator::ToolOptions tool_options(const ToolChoice& choice, simulator::ToolOptions of_scene);

/// Returns the flags of `choice` that have no effect on the resulting tool; empty: all have.
std::string flags_of_no_use(const ToolChoice& choice, const simulator::ToolOptions& options);

/// Returns the choice as arguments of 'forcegrid simulate'.
std::vector<std::string> tool_arguments(const ToolChoice& choice);

}  // namespace forcegrid::cli
