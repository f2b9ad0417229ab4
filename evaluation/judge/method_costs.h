// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "evaluation/judge/stopwatch.h"

namespace forcegrid::evaluation {

/// What the calls of a method cost on a trace. NaN: there were no such calls.
struct MethodCosts {
  double query_ns_median = 0.0;  ///< force(), or forces() for both tools
  double query_ns_p99 = 0.0;
  double sample_us_median = 0.0;  ///< take_sample() and the work() that it caused
  double sample_us_p99 = 0.0;
  double cycle_ns = 0.0;  ///< mean time per cycle in the method, samples included
  double cycle_ns_median = 0.0;
  double cycle_ns_p99 = 0.0;
  double cycle_ns_p999 = 0.0;
  /// The timer's floor: the smallest step between two readings of the clock. No time of a call, and
  /// no mean of a cycle, is reported below it; that of a query, a mean of eight, not below an
  /// eighth of it.
  double timer_floor_ns = 0.0;
};

/// Times the calls of a method, cycle after cycle, with Stopwatch.
/// Real-time: no. Threads: one.
class CostMeter {
 public:
  explicit CostMeter(std::size_t cycles);

  void begin_cycle() { this_cycle_ns_ = 0.0; }
  void end_cycle() { cycle_ns_.push_back(this_cycle_ns_); }

  /// A call that counts in its cycle only. @returns its time [ns].
  template <typename Call>
  double time(const Call& call) {
    const double ns = stopwatch_.ns_of(call);
    this_cycle_ns_ += ns;
    return ns;
  }

  /// A call that takes a sample.
  template <typename Call>
  void time_sample(const Call& call) {
    sample_ns_.push_back(time(call));
  }

  /// Work, which the newest sample caused.
  template <typename Call>
  void time_work(const Call& call) {
    const double ns = time(call);
    if (!sample_ns_.empty()) {
      sample_ns_.back() += ns;
    }
  }

  /// A query. Clocks tick in steps of up to 10 ns, so one that takes less than 1 us is timed as the
  /// mean of eight.
  /// @param query  asks and keeps the answer.
  /// @param again  again(i) asks at the i-th instant from this one on and returns a number of the
  ///     answer. Queries change nothing, so these do not affect later answers.
  template <typename Query, typename Again>
  void time_query(const Query& query, const Again& again) {
    double ns = time(query);
    if (ns < kShortQuery_ns) {
      ns = stopwatch_.ns_of([&] {
        for (std::size_t i = 0; i < kQueriesInARow; ++i) {
          discarded_ = again(i);
        }
      }) / static_cast<double>(kQueriesInARow);
    }
    query_ns_.push_back(ns);
  }

  /// Of each cycle the least of its time and that in `least_ns`, in both; an empty one is filled.
  /// @throws std::invalid_argument for another number of cycles.
  void take_least(std::vector<double>& least_ns);

  MethodCosts costs();

 private:
  static constexpr double kShortQuery_ns = 1000.0;
  static constexpr std::size_t kQueriesInARow = 8;

  const Stopwatch stopwatch_;
  double this_cycle_ns_ = 0.0;
  volatile double discarded_ = 0.0;  ///< so that no query is optimised away
  std::vector<double> query_ns_;
  std::vector<double> sample_ns_;
  std::vector<double> cycle_ns_;
};

}  // namespace forcegrid::evaluation
