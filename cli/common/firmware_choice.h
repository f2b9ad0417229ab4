// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "driver/falcon_firmware.h"
#include "profiles/device_profile.h"

namespace forcegrid::cli {

/// Returns the firmware to load into a device that runs none: the named file, or a synthetic image
/// for an emulated Falcon.
/// @throws std::runtime_error if the device keeps its firmware, or the file holds none.
driver::falcon::Firmware firmware_for(const std::string& file,
                                      const profiles::DeviceProfile& profile, bool emulated);

}  // namespace forcegrid::cli
