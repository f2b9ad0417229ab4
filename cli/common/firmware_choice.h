#pragma once

#include <string>

#include "driver/falcon_firmware.h"
#include "profiles/device_profile.h"

namespace forcegrid::cli {

/// What a device that runs none is given: the named file; a synthetic image for an emulated Falcon.
/// @throws std::runtime_error for a device that keeps its firmware, or a file that is none.
driver::falcon::Firmware firmware_for(const std::string& file,
                                      const profiles::DeviceProfile& profile, bool emulated);

}  // namespace forcegrid::cli
