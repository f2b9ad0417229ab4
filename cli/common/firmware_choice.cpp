// SPDX-License-Identifier: Apache-2.0
#include "cli/common/firmware_choice.h"

#include <stdexcept>

namespace forcegrid::cli {
driver::falcon::Firmware firmware_for(const std::string& file,
                                      const profiles::DeviceProfile& profile, bool emulated) {
  const bool falcon = profile.usb.protocol == "falcon";
  if (!file.empty()) {
    if (!falcon) {
      throw std::runtime_error("--firmware " + file + ": profile " + profile.name +
                               " describes a device that keeps its firmware; leave it out");
    }
    return driver::falcon::load_firmware(file);
  }
  return emulated && falcon ? driver::falcon::synthetic_firmware() : driver::falcon::Firmware{};
}

}  // namespace forcegrid::cli
