// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// Where a device is.
struct DeviceUrl {
  enum class Kind : std::uint8_t {
    kHidId,    ///< hid:VID:PID or hid:VID:PID:serial
    kHidNode,  ///< hid:/dev/hidrawN or hid:/dev/forcegrid/LINK
    kHidPort,  ///< hid:path=BUS-PORT, the USB port as sysfs names it
    kUsbip,    ///< usbip://HOST:PORT/BUSID
    kFalcon,   ///< falcon, falcon:SERIAL or falcon:path=BUS-PORT
  };

  std::string text;  ///< as it was written
  Kind kind = Kind::kHidId;
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::string serial;     ///< empty: any
  std::string node;       ///< "/dev/hidraw3", or the link that udev makes to it
  std::string port_path;  ///< "1-2" or "1-2.4"
  std::string host;       ///< name or address, without brackets
  std::uint16_t tcp_port = 0;
  std::string bus_id;  ///< "1-1"
};

/// Reads one of
///   hid:1234:0006            vendor and product, four hexadecimal digits each
///   hid:1234:0006:SERIAL     and the serial number
///   hid:/dev/hidraw3
///   hid:/dev/forcegrid/LINK  where udev/10-forcegrid.rules links to it
///   hid:path=1-2             the USB port, for devices that share a serial number
///   falcon                   the attached Novint Falcon
///   falcon:SERIAL            the one with this serial number
///   falcon:path=1-2          the one at this USB port
///   usbip://HOST:3240/1-1    a device on a USB/IP server; an IPv6 address in brackets
/// (`emulated:NAME` is the caller's.)
/// @throws DeviceError naming the part that is wrong and the forms there are.
/// Real-time: no. Threads: any.
DeviceUrl parse_device_url(const std::string& text);

/// A text of the forms that parse_device_url() takes, one a line, for --help and messages.
const char* device_url_forms() noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::driver
