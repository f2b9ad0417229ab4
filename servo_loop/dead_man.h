// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>

#include "rt/clock.h"

namespace forcegrid::servo {

/// What the user must hold for force to be rendered.
enum class DeadMan : std::uint8_t {
  kNone,    ///< nothing
  kButton,  ///< any button of the device
  kSignal,  ///< a DeadManSignal
  kSwitch,  ///< a ForceSwitch, which a program holds; buttons are the program's then, too
};

/// A program's own switch for all force. Off: zero force in the next cycle, without the fade that
/// lets a hand down gently. On: the motors are checked if they have not been, then the force ramps
/// in.
/// Real-time: wait-free. Threads: any.
class ForceSwitch {
 public:
  void turn(bool on) noexcept { on_.store(on); }
  /// As off for as long as it lasts, wherever the switch stands.
  void hold_back(bool held) noexcept { held_back_.store(held); }
  bool turned_on() const noexcept { return on_.load(); }
  bool on() const noexcept { return on_.load() && !held_back_.load(); }

 private:
  std::atomic<bool> on_{false};
  std::atomic<bool> held_back_{false};
  static_assert(std::atomic<bool>::is_always_lock_free);
};

/// The sign of life of an external switch, such as a pedal. The switch counts as held for kHold
/// after each sign.
/// Real-time: wait-free. Threads: any; sign() also in a signal handler.
class DeadManSignal {
 public:
  static constexpr rt::Duration kHold = std::chrono::milliseconds(200);

  void sign(rt::TimePoint now) noexcept { last_.store(now.time_since_epoch().count()); }
  bool held(rt::TimePoint now) const noexcept {
    const std::int64_t last = last_.load();
    return last != 0 && now - rt::TimePoint(rt::Duration(last)) <= kHold;
  }

 private:
  std::atomic<std::int64_t> last_{0};
  static_assert(std::atomic<std::int64_t>::is_always_lock_free);
};

}  // namespace forcegrid::servo
