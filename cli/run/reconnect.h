#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::cli {

/// A device that has gone, and how it is met again.
struct Reconnect {
  std::function<std::unique_ptr<driver::Device>()> open;  ///< throws driver::DeviceError
  std::function<bool()> cancelled;                        ///< asked often; true gives up
  std::function<void(const std::string&)> say;            ///< a line for the person
  const profiles::DeviceProfile* profile = nullptr;
  driver::DeviceIdentity before;              ///< the device that has gone
  std::array<std::int32_t, 6> last_counts{};  ///< its last counters
  bool may_calibrate = true;  ///< a person is there to calibrate it; else its counters must do
  rt::Duration timeout{};     ///< how long it may stay away
};

/// What became of it.
struct Reconnected {
  std::unique_ptr<driver::Device> device;  ///< null: not back, for the reason in `why_not`
  std::string why_not;
  bool recalibrated = false;
};

/// Waits until the same device can be opened again, and makes sure of its counters: a board that
/// lives on its cable has lost them, and does not say so. The arm is calibrated anew; where nobody
/// can do that, they are believed if nothing speaks against it (see why_counters_are_lost()), or
/// refused with the reason. A device that is back but can't be
/// opened is tried again, as it may still be starting; the last reason is given at the time-out.
/// Real-time: no.
Reconnected reconnect(const Reconnect& how);

}  // namespace forcegrid::cli
