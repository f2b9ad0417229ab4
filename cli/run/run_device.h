// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "cli/run/run_command.h"
#include "driver/device.h"
#include "driver/open_device.h"
#include "profiles/device_profile.h"

namespace forcegrid::cli {

/// Returns the file of the opened unit's calibrated profile; empty: none applies.
/// @param lasting_url  of the device, see driver::lasting_url()
std::string calibrated_profile(const RunOptions& options, const std::string& profile_name,
                               const driver::DeviceIdentity& identity,
                               const std::string& lasting_url);

/// Opens a run's device; its notices go to standard error.
/// @param realtime  its I/O thread may ask for real-time scheduling
/// @throws driver::DeviceError, for a device that is attached to this computer with a list of those
///         that are.
std::unique_ptr<driver::Device> open_for_run(const std::string& url,
                                             const profiles::DeviceProfile& profile,
                                             const driver::falcon::Firmware& firmware,
                                             const RunOptions& options, bool realtime);

}  // namespace forcegrid::cli
