// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

namespace forcegrid::servo {
#pragma GCC visibility push(default)

/// What has pressed the emergency stop.
enum class EmergencySource : std::uint8_t {
  kNone,
  kSignal,        ///< SIGUSR1, from another program that watches over the user
  kKey,           ///< a key in the terminal
  kDeviceButton,  ///< a button of the device
  kView,          ///< the stop in the live view's page
};

/// Short name for programs, e.g. "device_button".
const char* name_of(EmergencySource source) noexcept;
/// For people, e.g. "a button of the device".
const char* words_of(EmergencySource source) noexcept;

/// A latch that, once pressed, stays pressed. The first source is remembered.
/// Real-time: wait-free. Threads: any; press() also in a signal handler.
class EmergencyStop {
 public:
  void press(EmergencySource source) noexcept {
    EmergencySource none = EmergencySource::kNone;
    source_.compare_exchange_strong(none, source);
  }
  EmergencySource source() const noexcept { return source_.load(); }
  bool pressed() const noexcept { return source() != EmergencySource::kNone; }

 private:
  std::atomic<EmergencySource> source_{EmergencySource::kNone};
  static_assert(std::atomic<EmergencySource>::is_always_lock_free);
};

#pragma GCC visibility pop
}  // namespace forcegrid::servo
