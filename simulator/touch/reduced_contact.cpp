// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/reduced_contact.h"

#include "simulator/mesh/error.h"
#include "simulator/touch/sticking_tool.h"
#include "simulator/touch/sticky_contact_steps.h"

namespace forcegrid::simulator {

FORCEGRID_INSTANTIATE_STICKY_CONTACT(ReducedObject);

std::unique_ptr<ToolContact> make_reduced_contact(const Scene& scene,
                                                  const ReducedObjectOptions& solver,
                                                  const ToolOptions& options) {
  if (options.slides()) {
    throw Error(
        "tool: --solver reduced needs a patch that the tool holds; give --contact sticky, or leave "
        "--solver out");
  }
  return std::make_unique<StickingTool<ReducedObject>>(
      scene, solver,
      ContactOptions{.patch_radius_m = scene.patch_radius_m, .tool = tool_shape(options)});
}

}  // namespace forcegrid::simulator
