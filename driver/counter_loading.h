// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>

#include "driver/w2_codec.h"
#include "rt/clock.h"

namespace forcegrid::driver {

/// Encoder counters that a device is to take with command 1.
struct CounterRequest {
  std::uint32_t id = 0;
  std::array<std::int16_t, 6> counts{};
  rt::TimePoint deadline{};
};

/// What a report says about it.
enum class CountersTaken : std::uint8_t {
  kNo,
  kArmOnly,  ///< a, b, c; not d, e, f: the device has no counters for a wrist
  kAll,
};

/// [counts] An arm in a hand may move so far within an exchange.
inline constexpr int kCounterTolerance = 200;

/// Real-time: no allocation, lock or throw. Threads: any.
[[nodiscard]] inline CountersTaken counters_taken(const CounterRequest& request,
                                                  const w2::InputReport& report) noexcept {
  const auto taken = [&](std::size_t from, std::size_t to) {
    bool all = true;
    for (std::size_t i = from; i < to; ++i) {
      all = all && std::abs(report.counts[i] - request.counts[i]) <= kCounterTolerance;
    }
    return all;
  };
  if (report.calibration_button || !taken(0, 3)) {
    return CountersTaken::kNo;
  }
  return taken(3, 6) ? CountersTaken::kAll : CountersTaken::kArmOnly;
}

/// What to tell and to do. Static text.
[[nodiscard]] inline const char* why_not_taken(bool arm_only) noexcept {
  return arm_only ? "it took the arm's counters but not those of the wrist, d, e and f: it has no "
                    "encoders there; use a profile without [gimbal]"
                  : "it did not take the encoder counters; hold the arm still in its calibration "
                    "pose and try again";
}

}  // namespace forcegrid::driver
