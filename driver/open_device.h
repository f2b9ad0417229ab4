// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "driver/device.h"
#include "driver/falcon_firmware.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

struct OpenOptions {
  rt::Duration connect_timeout = std::chrono::seconds(2);  ///< USB/IP: connecting, and each step
  rt::Duration open_timeout = std::chrono::seconds(3);     ///< until the first report
  /// How long nothing more may come before a report is taken for the newest, while opening.
  rt::Duration settle_at_open = std::chrono::milliseconds(20);
  rt::Duration stale_after = std::chrono::milliseconds(100);
  rt::Duration servo_silence = std::chrono::milliseconds(50);  ///< then zero current is sent
  rt::Duration write_timeout = std::chrono::milliseconds(50);  ///< until the device took a report
  falcon::Firmware firmware;  ///< for a Falcon in which none runs; empty: none
  /// A program that has the device's hidraw node open, too, is no obstacle. If it sends anything,
  /// the device ends as DeviceHealth::kSecondWriter all the same.
  bool share = false;
  bool realtime_io = true;  ///< ask for SCHED_FIFO for the I/O thread
  /// Called on the opening thread with what the user should know, e.g. that real-time scheduling
  /// was refused. May be empty.
  std::function<void(const std::string&)> notice;
};

/// Opens the device that `url` names (see device_url.h), checks that it is what `profile` says, and
/// starts its exchange: the newest report is there when this returns, motors have zero current.
///
/// The profile's protocol says what is spoken. A Falcon is brought up first, which may take some
/// seconds and options.firmware (see falcon_startup.h); it is checked by vendor and product number.
///
/// Checked before the first OUT to a W2 device: vendor and product number (unless the node or port
/// was named), then the HID report descriptor: usage page, usage, report lengths, no report IDs.
/// The older W1 protocol has the same numbers and strings and is refused by name.
/// @throws DeviceError naming the device, what happened and the remedy; also for a profile whose
///         device `url` can't be.
/// Real-time: no; before the loop. Threads: any.
std::unique_ptr<Device> open_device(const std::string& url, const profiles::DeviceProfile& profile,
                                    const OpenOptions& options = {});

/// A URL that finds the same device again after a reconnection. A hidraw node becomes its USB port,
/// since the kernel renumbers nodes and devices of one kind may share a serial number; any other
/// URL stays as it is.
/// @throws DeviceError as open_device() when there is no such device.
/// Real-time: no. Threads: any.
std::string lasting_url(const std::string& url, const profiles::DeviceProfile& profile);

#pragma GCC visibility pop
}  // namespace forcegrid::driver
