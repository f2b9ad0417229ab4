// SPDX-License-Identifier: Apache-2.0
#include "driver/library_versions.h"

#include <hidapi.h>
#include <libusb.h>

namespace forcegrid::driver {

std::vector<std::pair<std::string, std::string>> library_versions() {
  const libusb_version* const usb = libusb_get_version();
  return {{"hidapi", hid_version_str()},
          {"libusb", std::to_string(usb->major) + "." + std::to_string(usb->minor) + "." +
                         std::to_string(usb->micro)}};
}

}  // namespace forcegrid::driver
