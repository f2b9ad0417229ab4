#include "cli/tool_option.h"

#include "cli/number_check.h"

namespace forcegrid::cli {
namespace {

const std::vector<std::string> kTools = {"point", "sphere", "capsule", "grasper"};
const std::vector<std::string> kContacts = {"sticky", "slide"};

}  // namespace

void add_tool(CLI::App& command, ToolChoice& choice) {
  using contact::ToolShape;
  command.add_option("--tool", choice.tool, "With what the object is touched, see docs/contact.md")
      ->check(CLI::IsMember(kTools))
      ->capture_default_str();
  command
      .add_option("--contact", choice.contact,
                  "What a touch is: sticky (the tool holds what it touches) or slide (it presses, "
                  "slides with friction, leaves)")
      ->check(CLI::IsMember(kContacts))
      ->capture_default_str();
  command.add_option("--tool-radius-mm", choice.radius_mm, "Radius of a sphere, capsule or jaw")
      ->check(between(1e3 * ToolShape::kMinRadius_m, 1e3 * ToolShape::kMaxRadius_m))
      ->capture_default_str()
      ->type_name("FLOAT mm");
  command.add_option("--tool-length-mm", choice.length_mm, "Length of a capsule or jaw")
      ->check(between(0.0, 1e3 * ToolShape::kMaxLength_m))
      ->capture_default_str()
      ->type_name("FLOAT mm");
  command.add_option("--friction", choice.friction, "Coulomb's mu of a sliding contact")
      ->check(between(0.0, 2.0))
      ->capture_default_str()
      ->type_name("FLOAT mu");
}

simulator::ToolOptions tool_options(const ToolChoice& choice) {
  simulator::ToolOptions options;
  options.shape = choice.tool;
  options.contact = choice.contact;
  options.radius_m = 1e-3 * choice.radius_mm;
  options.length_m = 1e-3 * choice.length_mm;
  options.friction = choice.friction;
  return options;
}

std::vector<std::string> tool_arguments(const ToolChoice& choice) {
  return {"--tool",           choice.tool,
          "--contact",        choice.contact,
          "--tool-radius-mm", std::to_string(choice.radius_mm),
          "--tool-length-mm", std::to_string(choice.length_mm),
          "--friction",       std::to_string(choice.friction)};
}

}  // namespace forcegrid::cli
