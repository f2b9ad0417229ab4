// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/tool_options.h"

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {

void check_together(const ToolOptions& options) {
  if (options.contact != "sticky" && options.contact != "slide") {
    throw Error("tool: unknown contact '" + options.contact + "'; write sticky or slide");
  }
  if (options.slides() && options.shape == "point") {
    throw Error(
        "tool: a point has nothing to press with; give a sphere, capsule, grasper or blade with "
        "contact slide");
  }
  if (!options.slides() && options.shape == "grasper") {
    throw Error("tool: a grasper presses before it grasps; give contact slide with it");
  }
  check_positive(options.grasp_N, "tool: grasp_N, the force that closes a grasper,");
  check_positive(options.let_go_N, "tool: let_go_N, the pull that opens a grasper,");
}

}  // namespace forcegrid::simulator
