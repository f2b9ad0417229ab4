// SPDX-License-Identifier: Apache-2.0
#include "cli/common/scene_option.h"

#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::cli {

Check scene_check() {
  return Check{[](const std::string& input) { return simulator::scene_name_problem(input); },
               "{" + joined(simulator::scene_names()) + ", FILE.toml}"};
}

std::string scene_help() { return "a scene by its name, or a TOML file; see docs/scenes.md"; }

}  // namespace forcegrid::cli
