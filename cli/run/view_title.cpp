// SPDX-License-Identifier: Apache-2.0
#include "cli/run/view_title.h"

#include "cli/common/revision.h"

namespace forcegrid::cli {

ViewTitle view_title(const RunOptions& options, const RunMethods& methods,
                     const MethodOptions& method_options, const servo::ServoOptions& servo_options,
                     const RunProcesses& processes) {
  ViewTitle title;
  title.version = program_version();
  title.device =
      (options.device_number > 0 ? "device " + std::to_string(options.device_number) + ": " : "") +
      options.device;
  title.scene = options.simulator.empty() ? options.scene : processes.simulator_address();
  title.methods = methods.names();
  for (const char* candidate : methods.rendered().candidates()) {
    title.candidates.emplace_back(candidate);
  }
  title.rate_Hz = options.rate_Hz;
  title.simulator_rate_Hz = servo_options.simulator_rate_Hz;
  title.method_options = method_options;
  title.fill_budget = servo_options.fill_budget;
  title.requests_per_s = servo_options.requests_per_s;
  title.emulated = processes.has_emulator();
  return title;
}

}  // namespace forcegrid::cli
