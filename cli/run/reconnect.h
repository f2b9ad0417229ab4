// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::cli {

/// A device that was disconnected, and how to connect to it again.
struct Reconnect {
  std::function<std::unique_ptr<driver::Device>()> open;  ///< throws driver::DeviceError
  std::function<bool()> cancelled;                        ///< polled; true gives up
  std::function<void(const std::string&)> say;            ///< prints a line for the user
  const profiles::DeviceProfile* profile = nullptr;
  driver::DeviceIdentity before;              ///< the disconnected device
  std::array<std::int32_t, 6> last_counts{};  ///< its last counters
  /// A user is present to calibrate it; otherwise its counters must be valid.
  bool may_calibrate = true;
  rt::Duration timeout{};  ///< longest time to wait for it
};

/// Result of reconnect().
struct Reconnected {
  std::unique_ptr<driver::Device> device;  ///< null: not connected, see `why_not`
  std::string why_not;
  bool recalibrated = false;
};

/// Waits until the same device can be opened again, and ensures that its encoder counters are
/// valid. A board that is powered by its cable loses them without reporting it, so the arm is
/// calibrated again. If no user can do that, the counters are accepted unless
/// why_counters_are_lost() objects; otherwise the device is refused with that reason. A device that
/// is present but can't be opened may still be starting and is tried again until the time-out,
/// which reports the last reason.
/// Real-time: no.
Reconnected reconnect(const Reconnect& how);

}  // namespace forcegrid::cli
