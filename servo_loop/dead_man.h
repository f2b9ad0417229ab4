#pragma once

#include <atomic>
#include <cstdint>

#include "rt/clock.h"

namespace forcegrid::servo {

/// What has to be held for force to be rendered.
enum class DeadMan : std::uint8_t {
  kNone,    ///< nothing
  kButton,  ///< any button of the device
  kSignal,  ///< a DeadManSignal
};

/// The sign of life of a switch outside of the device, such as a pedal: held as long as it comes
/// again within kHold.
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
