// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rt/clock.h"

namespace forcegrid::driver {

/// A device that a USB/IP server offers.
struct UsbipListing {
  std::string bus_id;  ///< "1-1"
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
};

/// What the server at `host`:`port` offers (OP_REQ_DEVLIST); nothing is imported. Nothing that it
/// sends is trusted: at most 1024 devices, and every length is the protocol's.
/// Source: Linux Documentation/usb/usbip_protocol.rst, version 0x0111.
/// @param timeout of connecting, and again of each answer.
/// @throws DeviceError with the system's words and the remedy.
/// Real-time: no. Threads: any.
std::vector<UsbipListing> list_usbip_devices(const std::string& host, std::uint16_t port,
                                             rt::Duration timeout);

}  // namespace forcegrid::driver
