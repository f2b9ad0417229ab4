// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "servo_loop/servo_ports.h"
#include "servo_loop/telemetry.h"

namespace forcegrid::session {

/// Times of a motor thread's cycles, written as JSON when the session ends:
///
///   cycles, missed_deadlines   counts
///   realtime                   whether SCHED_FIFO was granted
///   wakeup_us, period_us, compute_us, report_age_us
///                              each p10, p50, p99, p999 and max [us]
///
/// A thread of its own drains the records. The motor thread copies one record a cycle into the
/// ring, as in `forcegrid run`.
/// Real-time: no. Threads: one.
class MotorTiming {
 public:
  /// @throws SessionError (kUnusable) naming the file and the remedy if it can't be written.
  MotorTiming(servo::ServoPorts& ports, double rate_Hz, std::string file);

  /// Drains what is left and writes the file. To be called once, after the last cycle.
  /// @returns why it could not be written; empty: it was.
  [[nodiscard]] std::string finish(bool realtime);

 private:
  std::string file_;
  servo::Telemetry telemetry_;
};

}  // namespace forcegrid::session
