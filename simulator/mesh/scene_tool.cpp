// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/scene_tool.h"

#include <algorithm>
#include <initializer_list>
#include <string>
#include <vector>

#include "contact/tool_shape.h"
#include "simulator/mesh/error.h"
#include "text/nearest_name.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using contact::ToolShape;
using text::NumberRange;
using text::TomlTable;

constexpr NumberRange kRadius_m{ToolShape::kMinRadius_m, ToolShape::kMaxRadius_m,
                                "a radius in metres from 0.0001 to 0.1"};
constexpr NumberRange kLength_m{0.0, ToolShape::kMaxLength_m, "a length in metres from 0 to 0.5"};
constexpr NumberRange kOpening_rad{0.0, ToolShape::kMaxOpening_rad,
                                   "an angle in radians from 0 to 1.6"};
constexpr NumberRange kFriction{0.0, ToolOptions::kMaxFriction,
                                "a coefficient of friction from 0 to 2"};
constexpr NumberRange kForce_N{1e-3, 100.0, "a force in newtons from 0.001 to 100"};

const std::vector<std::string> kToolKeys{"shape",    "contact",     "radius_m",
                                         "length_m", "opening_rad", "friction",
                                         "grasp_N",  "let_go_N",    "turns"};
const std::vector<std::string> kToolShapes{"point", "sphere", "capsule", "grasper", "blade"};
const std::vector<std::string> kContacts{"sticky", "slide"};

std::string choice_or(const TomlTable& tool, const char* key, const std::vector<std::string>& known,
                      const std::string& otherwise) {
  const std::string text = tool.text_or(key, otherwise);
  if (std::find(known.begin(), known.end(), text) == known.end()) {
    tool.refuse(key, "'" + text + "' is unknown",
                "write one of: " + text::joined(known) + " (the nearest is " +
                    text::nearest_name(text, known) + ")");
  }
  return text;
}

// A key without effect is the author's mistake.
void only_where(bool of_use, const TomlTable& tool, std::initializer_list<const char*> keys,
                const std::string& what, const std::string& instead) {
  for (const char* key : keys) {
    if (!of_use && tool.has(key)) {
      tool.refuse(key, what + " has none", "leave it out or write " + instead);
    }
  }
}

}  // namespace

ToolOptions read_scene_tool(const TomlTable& root) {
  ToolOptions options;
  if (!root.has("tool")) {
    return options;
  }
  const TomlTable tool = root.table("tool", kToolKeys);
  options.shape = choice_or(tool, "shape", kToolShapes, options.shape);
  options.contact = choice_or(tool, "contact", kContacts, options.contact);
  const bool grasper = options.shape == "grasper";
  const std::string shape = "shape \"" + options.shape + "\"";
  only_where(options.shape != "point", tool, {"radius_m"}, shape, "shape = \"sphere\"");
  only_where(options.has_length(), tool, {"length_m"}, shape, "shape = \"capsule\"");
  only_where(grasper, tool, {"opening_rad", "grasp_N", "let_go_N"}, shape, "shape = \"grasper\"");
  only_where(options.slides(), tool, {"friction"}, "contact \"" + options.contact + "\"",
             "contact = \"slide\"");
  options.radius_m = tool.number_or("radius_m", kRadius_m, options.radius_m);
  options.length_m = tool.number_or("length_m", kLength_m, options.length_m);
  options.opening_rad = tool.number_or("opening_rad", kOpening_rad, options.opening_rad);
  options.friction = tool.number_or("friction", kFriction, options.friction);
  options.grasp_N = tool.number_or("grasp_N", kForce_N, options.grasp_N);
  options.let_go_N = tool.number_or("let_go_N", kForce_N, options.let_go_N);
  options.turns = tool.flag_or("turns", options.turns);
  try {
    check_together(options);
  } catch (const Error& problem) {
    tool.refuse("shape", problem.what(), "change shape or contact of [tool]");
  }
  return options;
}

}  // namespace forcegrid::simulator
