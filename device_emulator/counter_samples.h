// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "device_emulator/emulator_report.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// The newest counter samples of a device, in a ring that is allocated once.
/// Real-time: add() neither allocates, locks nor throws. Threads: one.
class CounterSamples {
 public:
  /// Number of samples kept.
  static constexpr std::size_t kCapacity = 4096;

  /// @param counts encoder counters at `time`; those that the device does not have are 0.
  void add(rt::TimePoint time, const std::array<std::int32_t, 6>& counts) noexcept {
    CounterSample& sample = ring_[count_ % kCapacity];
    sample.time_ns = std::chrono::nanoseconds(time.time_since_epoch()).count();
    sample.counts = counts;
    ++count_;
  }

  /// Oldest first.
  [[nodiscard]] std::vector<CounterSample> newest() const {
    std::vector<CounterSample> result;
    result.reserve(std::min(count_, kCapacity));
    for (std::size_t i = count_ - std::min(count_, kCapacity); i < count_; ++i) {
      result.push_back(ring_[i % kCapacity]);
    }
    return result;
  }

 private:
  std::vector<CounterSample> ring_ = std::vector<CounterSample>(kCapacity);
  std::size_t count_ = 0;
};

}  // namespace forcegrid::emulator
