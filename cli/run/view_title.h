// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/run/run_command.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_processes.h"
#include "cli/run/view_feed.h"
#include "servo_loop/servo_options.h"

namespace forcegrid::cli {

/// What runs, for the live view and for recordings. It names no socket of a hand.
ViewTitle view_title(const RunOptions& options, const RunMethods& methods,
                     const MethodOptions& method_options, const servo::ServoOptions& servo_options,
                     const RunProcesses& processes);

}  // namespace forcegrid::cli
