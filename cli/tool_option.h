#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "simulator/tool_contact.h"

namespace forcegrid::cli {

/// --tool, --contact and what belongs to them.
struct ToolChoice {
  std::string tool = "point";
  std::string contact = "sticky";
  double radius_mm = 8.0;
  double length_mm = 40.0;
  double friction = 0.3;

  bool slides() const { return contact == "slide"; }
  bool as_always() const { return tool == "point" && contact == "sticky"; }
};

void add_tool(CLI::App& command, ToolChoice& choice);

simulator::ToolOptions tool_options(const ToolChoice& choice);

/// The choice as arguments of 'forcegrid simulate'.
std::vector<std::string> tool_arguments(const ToolChoice& choice);

}  // namespace forcegrid::cli
