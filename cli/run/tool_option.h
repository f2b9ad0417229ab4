#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// --tool, --contact and what belongs to them; what is not given is the scene's.
struct ToolChoice {
  std::optional<std::string> tool;
  std::optional<std::string> contact;
  std::optional<double> radius_mm;
  std::optional<double> length_mm;
  std::optional<double> friction;

  bool given() const { return tool || contact || radius_mm || length_mm || friction; }
};

void add_tool(CLI::App& command, ToolChoice& choice);

/// A scene's tool with the changes that were asked for.
simulator::ToolOptions tool_options(const ToolChoice& choice, simulator::ToolOptions of_scene);

/// The flags of `choice` that mean nothing to the tool that came of it; empty: all count.
std::string flags_of_no_use(const ToolChoice& choice, const simulator::ToolOptions& options);

/// What was asked for, as arguments of 'forcegrid simulate'.
std::vector<std::string> tool_arguments(const ToolChoice& choice);

}  // namespace forcegrid::cli
