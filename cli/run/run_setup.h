// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/run/run_command.h"
#include "forcegrid/core/method_options.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::cli {

/// Prefix of a profile's name for an emulated device, which `run` starts itself.
inline constexpr char kEmulatedPrefix[] = "emulated:";

/// Returns the name of the requested device's profile: an emulated device's own, else --profile,
/// else the default for that kind of device.
/// @throws driver::DeviceError for an invalid device URL.
std::string profile_name_of(const std::string& device, const std::string& profile);

/// Returns the options that force methods get for a run: the profile's workspace and the options of
/// grids.
MethodOptions method_options(const RunOptions& options, const profiles::DeviceProfile& profile,
                             const servo::WorkspaceMap& workspace);

}  // namespace forcegrid::cli
