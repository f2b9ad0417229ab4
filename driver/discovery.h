// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// A text for someone who has no device, or wonders why it is not seen: which devices were looked
/// for (those of `known`), what was found (every HID device, and which of them are known and may
/// be opened; every Falcon), and what to do next (udev rule, naming a device, running without one).
/// @param known  e.g. all profiles of available_profiles().
/// @param sysfs  where sysfs is mounted.
/// Real-time: no. Threads: any.
std::string describe_attached_devices(const std::vector<profiles::DeviceProfile>& known,
                                      const std::string& sysfs = "/sys");

#pragma GCC visibility pop
}  // namespace forcegrid::driver
