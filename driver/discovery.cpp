// SPDX-License-Identifier: Apache-2.0
#include "driver/discovery.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "driver/hidraw_nodes.h"
#include "driver/sysfs_file.h"

namespace forcegrid::driver {
namespace {

std::string ids(std::uint16_t vendor_id, std::uint16_t product_id) {
  char text[16];
  std::snprintf(text, sizeof text, "%04x:%04x", vendor_id, product_id);
  return text;
}

/// A device that has no HID node.
struct UsbDevice {
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::string serial;
  std::string port_path;  ///< "1-2.4"
};

/// The attached devices with the numbers of a profile of `protocol`, by their ports.
std::vector<UsbDevice> list_usb_devices(const std::vector<profiles::DeviceProfile>& known,
                                        const std::string& protocol, const std::string& sysfs) {
  std::vector<UsbDevice> found;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(sysfs + "/bus/usb/devices", error)) {
    const std::string vendor = first_line(entry.path() / "idVendor");
    const std::string product = first_line(entry.path() / "idProduct");
    for (const profiles::DeviceProfile& profile : known) {
      if (profile.usb.protocol == protocol &&
          vendor + ":" + product == ids(profile.usb.vendor_id, profile.usb.product_id)) {
        found.push_back({.vendor_id = profile.usb.vendor_id,
                         .product_id = profile.usb.product_id,
                         .serial = first_line(entry.path() / "serial"),
                         .port_path = entry.path().filename().string()});
        break;
      }
    }
  }
  std::sort(found.begin(), found.end(),
            [](const UsbDevice& a, const UsbDevice& b) { return a.port_path < b.port_path; });
  return found;
}

}  // namespace

std::string describe_attached_devices(const std::vector<profiles::DeviceProfile>& known,
                                      const std::string& sysfs) {
  std::string text = "Looked for devices of these profiles:\n";
  for (const profiles::DeviceProfile& profile : known) {
    text += "  " + ids(profile.usb.vendor_id, profile.usb.product_id) + "  " + profile.name + " (" +
            profile.description + ")\n";
  }
  const std::vector<HidrawNode> nodes = list_hidraw_nodes(sysfs);
  const std::vector<UsbDevice> falcons = list_usb_devices(known, "falcon", sysfs);
  text += nodes.empty() && falcons.empty() ? "Found: no HID device at all, and no Falcon.\n"
                                           : "Found:\n";
  bool any_known = !falcons.empty();
  bool any_forbidden = false;
  std::string example;
  for (const UsbDevice& falcon : falcons) {
    text += "  " + ids(falcon.vendor_id, falcon.product_id) + " at USB port " + falcon.port_path +
            (falcon.serial.empty() ? "" : ", serial " + falcon.serial) + " [known]\n";
    example = example.empty() ? "falcon:path=" + falcon.port_path : example;
  }
  for (const HidrawNode& node : nodes) {
    const bool is_known = std::any_of(known.begin(), known.end(), [&](const auto& profile) {
      return profile.usb.vendor_id == node.vendor_id && profile.usb.product_id == node.product_id;
    });
    text += "  " + describe(node);
    if (is_known) {
      any_known = true;
      if (example.empty()) {
        example = node.port_path.empty() ? "hid:" + node.node : "hid:path=" + node.port_path;
      }
      if (::access(node.node.c_str(), R_OK | W_OK) == 0) {
        text += " [known]";
      } else {
        any_forbidden = any_forbidden || errno == EACCES;
        text += std::string(" [known, but can't be opened: ") + std::strerror(errno) + "]";
      }
    }
    text += "\n";
  }
  text += "What to do:\n";
  if (any_known) {
    text += "  use it:             --device " + example + "\n";
  } else {
    text += "  with a device:      plug it in, switch its power on, and look again\n";
  }
  if (any_forbidden || !any_known) {
    text +=
        "  permission:         sudo cp udev/10-forcegrid.rules /etc/udev/rules.d/ &&\n"
        "                      sudo udevadm control --reload, then plug the device in again\n";
  }
  text +=
      "  another computer's: --device usbip://HOST:3240/BUSID\n"
      "  without a device:   --device emulated:woodenhaptics_v2015\n";
  return text;
}

}  // namespace forcegrid::driver
