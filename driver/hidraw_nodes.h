// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "driver/device_url.h"

namespace forcegrid::driver {

/// One hidraw node of this computer, as sysfs describes it.
struct HidrawNode {
  std::string node;       ///< "/dev/hidraw3"
  std::string port_path;  ///< USB port, "1-2"; empty when it is not a USB device
  std::string interface;  ///< USB interface, "1-2:1.0"; empty as above
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::string manufacturer;
  std::string product;
  std::string serial;
  std::vector<std::uint8_t> report_descriptor;
};

/// All hidraw nodes, sorted by number. One whose description can't be read is left out.
/// @param sysfs  where sysfs is mounted.
/// Real-time: no. Threads: any.
std::vector<HidrawNode> list_hidraw_nodes(const std::string& sysfs = "/sys");

/// The one node that `url` means.
/// @throws DeviceError when there is none (with what there is instead and what to do), or several
///         (with their ports).
HidrawNode select_hidraw_node(const DeviceUrl& url, const std::vector<HidrawNode>& nodes);

/// `nodes` without the other interfaces of composite devices: of several nodes at one USB port, of
/// which at least one has this HID usage, those that have another are left out. (A Teensy's second
/// interface, of the same vendor and product, emulates a serial line.)
std::vector<HidrawNode> without_other_interfaces(std::vector<HidrawNode> nodes,
                                                 std::uint16_t usage_page, std::uint16_t usage);

/// One line of text: "/dev/hidraw3 at USB port 1-2: 1234:0006 mbed.org HID DEVICE, serial
/// 0123456789".
std::string describe(const HidrawNode& node);

}  // namespace forcegrid::driver
