// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <mutex>
#include <optional>
#include <string>

#include "cli/run/run_command.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_processes.h"
#include "cli/run/view_feed.h"
#include "forcegrid/core/method_options.h"
#include "servo_loop/servo_options.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// The scene that a person has chosen to come next. Threads: any.
class NextScene {
 public:
  void choose(const std::string& scene) {
    const std::lock_guard lock(mutex_);
    scene_ = scene;
  }
  [[nodiscard]] std::optional<std::string> chosen() {
    const std::lock_guard lock(mutex_);
    return scene_;
  }

 private:
  std::mutex mutex_;
  std::optional<std::string> scene_;
};

/// What the live view is told of a run with these options: view_title(), and what can be changed
/// while it runs. `restart` is left to the caller.
/// @param processes  with a view.
ViewTitle live_title(const RunOptions& options, const RunProcesses& processes,
                     const RunMethods& methods, const MethodOptions& method_options,
                     const servo::ServoOptions& servo_options, const simulator::ToolOptions& tool);

}  // namespace forcegrid::cli
