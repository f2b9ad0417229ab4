#pragma once

#include <string>

#include "cli/run/run_command.h"
#include "forcegrid/core/method_options.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::cli {

/// "emulated:", before a profile's name: a device that `run` starts itself.
inline constexpr char kEmulatedPrefix[] = "emulated:";

/// The profile of the device that is asked for: an emulated one's own, else --profile, else that of
/// the kind of device.
/// @throws driver::DeviceError for a device that can't be understood.
std::string profile_name_of(const std::string& device, const std::string& profile);

/// What force methods are told of a run: its workspace, which is the profile's, and the options for
/// grids.
MethodOptions method_options(const RunOptions& options, const profiles::DeviceProfile& profile,
                             const servo::WorkspaceMap& workspace);

}  // namespace forcegrid::cli
