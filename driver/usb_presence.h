// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "rt/clock.h"

namespace forcegrid::driver {

/// Tells, once a node has ended, a device that was unplugged from one whose interface another
/// program took. Both end the node in the same way: a program that detaches the kernel's driver
/// (libusb_detach_kernel_driver) takes its node away.
class UsbPresence {
 public:
  /// The kernel takes the drivers off an unplugged device before the device itself disappears from
  /// sysfs, usually within 5 ms. A device that is there after this has not been unplugged.
  static constexpr rt::Duration kDisappears = std::chrono::milliseconds(60);

  /// Notes which device is at the port now.
  /// @param port_path  "1-2"; empty for a device that is not on USB, which is never called taken.
  /// @param interface  "1-2:1.0"
  explicit UsbPresence(std::string port_path, std::string interface, std::string sysfs = "/sys");

  /// Waits for at most kDisappears until it shows what has become of the device.
  /// @returns the driver that has its interface, "usbfs" for a program's; "none" for a device
  ///          without a driver; empty when the device is gone.
  /// Real-time: no.
  [[nodiscard]] std::string taken_by() const;

 private:
  [[nodiscard]] std::string number() const;

  std::string sysfs_;
  std::string port_path_;
  std::string interface_;
  std::string number_;  ///< of the device on its bus; another one has another
  std::string driver_;
};

}  // namespace forcegrid::driver
