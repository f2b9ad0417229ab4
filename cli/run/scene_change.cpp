// SPDX-License-Identifier: Apache-2.0
#include "cli/run/scene_change.h"

#include "log/log.h"

namespace forcegrid::cli {

RunOptions with_scene(RunOptions options, const std::string& scene) {
  if (options.material_tolerance_percent) {
    log::info("model", "--material-tolerance-percent was given for scene " + options.scene +
                           "; scene " + scene + " is simulated as written");
    options.material_tolerance_percent.reset();
  }
  options.scene = scene;
  options.open_view = false;
  return options;
}

}  // namespace forcegrid::cli
