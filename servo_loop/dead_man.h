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
