// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace forcegrid::rt {

/// The one clock of servo, driver and emulator: CLOCK_MONOTONIC, so that time stamps taken in
/// different processes of one machine can be compared.
using Clock = std::chrono::steady_clock;
using TimePoint = Clock::time_point;
using Duration = Clock::duration;

/// [s] `duration` as a number.
constexpr double seconds(Duration duration) noexcept {
  return std::chrono::duration<double>(duration).count();
}

/// `value_s` seconds as a duration, truncated to a nanosecond.
constexpr Duration from_seconds(double value_s) noexcept {
  return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(value_s));
}

}  // namespace forcegrid::rt
