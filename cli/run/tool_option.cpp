// SPDX-License-Identifier: Apache-2.0
#include "cli/run/tool_option.h"

#include <utility>

#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "contact/tool_shape.h"

namespace forcegrid::cli {
namespace {

const std::vector<std::string> kTools = {"point", "sphere", "capsule", "grasper", "blade"};
const std::vector<std::string> kContacts = {"sticky", "slide"};

}  // namespace

void add_tool(Command& command, ToolChoice& choice) {
  using contact::ToolShape;
  command
      .add_option(
          "--tool", choice.tool,
          "Shape of the tool that touches the object, see docs/contact.md (default: the scene's, "
          "else point)")
      ->check(one_of(kTools));
  command
      .add_option("--contact", choice.contact,
                  "Kind of contact: sticky (the tool holds what it touches) or slide (it presses, "
                  "slides with friction and leaves) (default: the scene's, else sticky)")
      ->check(one_of(kContacts));
  command
      .add_option("--tool-radius-mm", choice.radius_mm,
                  "Radius of a sphere, capsule, blade or jaw (default: the scene's, else 8)")
      ->check(between(1e3 * ToolShape::kMinRadius_m, 1e3 * ToolShape::kMaxRadius_m))
      ->type_name("FLOAT mm");
  command
      .add_option("--tool-length-mm", choice.length_mm,
                  "Length of a capsule, blade or jaw (default: the scene's, else 40)")
      ->check(between(0.0, 1e3 * ToolShape::kMaxLength_m))
      ->type_name("FLOAT mm");
  command
      .add_option("--friction", choice.friction,
                  "Coulomb's mu of a sliding contact, without a unit (default: the scene's, else "
                  "0.3)")
      ->check(between(0.0, simulator::ToolOptions::kMaxFriction))
      ->type_name("FLOAT");
  command.add_flag(
      "--tool-turns", choice.turns,
      "The tool turns with the hand of a device that has a wrist, and the simulator "
      "sends a torque, see docs/turning.md (default: as the scene's tool does, else it "
      "stays upright)");
}

simulator::ToolOptions tool_options(const ToolChoice& choice, simulator::ToolOptions of_scene) {
  simulator::ToolOptions options = std::move(of_scene);
  options.shape = choice.tool.value_or(options.shape);
  options.contact = choice.contact.value_or(options.contact);
  options.radius_m = choice.radius_mm ? 1e-3 * *choice.radius_mm : options.radius_m;
  options.length_m = choice.length_mm ? 1e-3 * *choice.length_mm : options.length_m;
  options.friction = choice.friction.value_or(options.friction);
  options.turns = options.turns || choice.turns;
  return options;
}

std::string flags_of_no_use(const ToolChoice& choice, const simulator::ToolOptions& options) {
  std::string flags;
  const auto add = [&flags](bool given, bool of_use, const char* flag) {
    if (given && !of_use) {
      flags += (flags.empty() ? "" : ", ") + std::string(flag);
    }
  };
  add(choice.radius_mm.has_value(), options.shape != "point", "--tool-radius-mm");
  add(choice.length_mm.has_value(), options.has_length(), "--tool-length-mm");
  add(choice.friction.has_value(), options.slides(), "--friction");
  return flags;
}

std::vector<std::string> tool_arguments(const ToolChoice& choice) {
  std::vector<std::string> arguments;
  const auto add = [&arguments](const char* flag, const std::string& value) {
    arguments.insert(arguments.end(), {flag, value});
  };
  const auto add_number = [&add](const char* flag, const std::optional<double>& value) {
    if (value) {
      add(flag, std::to_string(*value));
    }
  };
  if (choice.tool) {
    add("--tool", *choice.tool);
  }
  if (choice.contact) {
    add("--contact", *choice.contact);
  }
  add_number("--tool-radius-mm", choice.radius_mm);
  add_number("--tool-length-mm", choice.length_mm);
  add_number("--friction", choice.friction);
  if (choice.turns) {
    arguments.emplace_back("--tool-turns");
  }
  return arguments;
}

}  // namespace forcegrid::cli
