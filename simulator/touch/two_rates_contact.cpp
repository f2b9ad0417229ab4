// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/two_rates_contact.h"

#include "simulator/mesh/error.h"
#include "simulator/touch/sticking_tool.h"
#include "simulator/touch/sticky_contact_steps.h"

namespace forcegrid::simulator {

FORCEGRID_INSTANTIATE_STICKY_CONTACT(TwoRatesObject);

std::unique_ptr<ToolContact> make_two_rates_contact(const Scene& scene,
                                                    const TwoRatesOptions& solver,
                                                    const ToolOptions& options) {
  if (options.slides()) {
    throw Error(
        "tool: --contact slide needs the whole object; give --contact sticky with --solver "
        "two_rates, "
        "or leave --solver out");
  }
  return std::make_unique<StickingTool<TwoRatesObject>>(
      scene, solver,
      ContactOptions{.patch_radius_m = scene.patch_radius_m, .tool = tool_shape(options)});
}

}  // namespace forcegrid::simulator
