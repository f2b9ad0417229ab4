// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_command.h"

#include <memory>

#include "cli/common/stop_request.h"
#include "cli/run/run.h"
#include "cli/run/run_devices.h"
#include "cli/run/scene_change.h"
#include "cli/run/view_process.h"

namespace forcegrid::cli {

int run_command(const RunOptions& options) {
  if (options.devices.size() > 1) {
    return run_devices(options);
  }
  std::unique_ptr<ViewProcess> view;  // outlives every run, so that pages stay connected
  RunOptions now = the_only_device(options);
  for (;;) {
    Run run(now, view);
    const int status = run.execute();
    const auto scene = run.next_scene();
    if (!scene) {
      return status;
    }
    now = with_scene(now, *scene);
    StopRequest::forget();
  }
}

}  // namespace forcegrid::cli
