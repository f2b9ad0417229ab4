// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::servo {

/// All buttons of a device, taken as one.
///
/// A Falcon reports which of the four buttons on its grip are down. A W2 or W3 device has a
/// calibration button, which latches: the report says that it has been pressed since the counters
/// were loaded, not whether it is down. So it can be pressed once, and cannot be held. A stylus may
/// have a button, too, which works the tool: it can be held, and its press is none of the device.
/// Real-time: no allocation, lock or throw. Threads: one.
class DeviceButton {
 public:
  explicit DeviceButton(const profiles::DeviceProfile& profile) noexcept
      : tells_held_(can_be_held(profile)), latches_(profile.usb.protocol != "falcon") {}

  /// Whether a device of this profile reports that a button is being held.
  static bool can_be_held(const profiles::DeviceProfile& profile) noexcept {
    return profile.usb.protocol == "falcon" || profile.gimbal.stylus_button;
  }

  /// Takes a cycle's newest report.
  void update(const driver::DeviceReport& report) noexcept {
    if (report.sequence == 0) {
      return;
    }
    const bool down = latches_ ? report.calibration_button : report.buttons != 0;
    pressed_ = down && seen_up_;
    seen_up_ = seen_up_ || !down;
    held_ = tells_held_ && report.buttons != 0;
  }

  /// The device's button is down (a latching one: has gone down) and was up before. A button that
  /// has been down from the start does not count: it was pressed for another purpose.
  bool pressed() const noexcept { return pressed_; }
  /// A button is down; never true of a latching one.
  bool held() const noexcept { return held_; }

  /// The next reports belong to another connection.
  void restart() noexcept { seen_up_ = pressed_ = held_ = false; }

 private:
  bool tells_held_;
  bool latches_;
  bool seen_up_ = false;
  bool pressed_ = false;
  bool held_ = false;
};

}  // namespace forcegrid::servo
