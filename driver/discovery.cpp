#include "driver/discovery.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "driver/hidraw_nodes.h"

namespace forcegrid::driver {
namespace {

std::string ids(std::uint16_t vendor_id, std::uint16_t product_id) {
  char text[16];
  std::snprintf(text, sizeof text, "%04x:%04x", vendor_id, product_id);
  return text;
}

}  // namespace

std::string describe_attached_devices(const std::vector<profiles::DeviceProfile>& known,
                                      const std::string& sysfs) {
  std::string text = "Looked for HID devices of these profiles:\n";
  for (const profiles::DeviceProfile& profile : known) {
    text += "  " + ids(profile.usb.vendor_id, profile.usb.product_id) + "  " + profile.name + " (" +
            profile.description + ")\n";
  }
  const std::vector<HidrawNode> nodes = list_hidraw_nodes(sysfs);
  text += nodes.empty() ? "Found: no HID device at all.\n" : "Found:\n";
  bool any_known = false;
  bool any_forbidden = false;
  std::string example;
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
        "  permission:         sudo cp udev/70-forcegrid.rules /etc/udev/rules.d/ &&\n"
        "                      sudo udevadm control --reload, then plug the device in again\n";
  }
  text +=
      "  another computer's: --device usbip://HOST:3240/BUSID\n"
      "  without a device:   --device emulated:woodenhaptics_v2015\n";
  return text;
}

}  // namespace forcegrid::driver
