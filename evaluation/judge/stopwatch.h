// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "rt/clock.h"

namespace forcegrid::evaluation {

/// Times calls with rt::Clock. The mean cost of reading the clock is subtracted. The clock's step
/// may be as long as a call, so a single time may be wrong by a step and even be negative.
/// Real-time: no. Threads: one.
class Stopwatch {
 public:
  Stopwatch() {
    std::vector<double> readings_ns;
    for (int i = 0; i < 2000; ++i) {
      readings_ns.push_back(ns_of([] {}));
    }
    std::sort(readings_ns.begin(), readings_ns.end());
    for (std::size_t i = 500; i < 1500; ++i) {  // the middle half: no interruptions
      overhead_ns_ += readings_ns[i] / 1000.0;
    }
    for (std::size_t i = 1; i < readings_ns.size(); ++i) {
      const double step_ns = std::round(readings_ns[i] - readings_ns[i - 1]);
      floor_ns_ = step_ns > 0.0 && (floor_ns_ == 0.0 || step_ns < floor_ns_) ? step_ns : floor_ns_;
    }
    floor_ns_ = std::max(floor_ns_, kClockUnit_ns);
  }

  /// The smallest step between readings.
  double floor_ns() const noexcept { return floor_ns_; }

  template <typename Call>
  double ns_of(const Call& call) const {
    const rt::TimePoint before = rt::Clock::now();
    call();
    const rt::TimePoint after = rt::Clock::now();
    return 1e9 * rt::seconds(after - before) - overhead_ns_;
  }

 private:
  static constexpr double kClockUnit_ns = 1.0;  // in which rt::Clock counts

  double overhead_ns_ = 0.0;
  double floor_ns_ = 0.0;
};

}  // namespace forcegrid::evaluation
