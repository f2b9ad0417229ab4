// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/run/run_command.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::cli {

/// Returns the servo loop's options for a run and installs the switches of its user (SIGUSR1,
/// SIGUSR2).
/// @throws std::runtime_error if --dead-man names a button that the device does not have.
servo::ServoOptions servo_options_of(const RunOptions& options,
                                     const profiles::DeviceProfile& profile);

}  // namespace forcegrid::cli
