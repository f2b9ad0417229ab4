// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>

#include "servo_loop/dead_man.h"
#include "servo_loop/emergency_stop.h"

namespace forcegrid::cli {

/// Counts the requests to end this process: each SIGINT (Ctrl-C), SIGTERM and SIGHUP counts as one.
/// SIGUSR1 and SIGUSR2 are switches of the device's user.
/// Threads: any thread may read. The flags are lock-free and safe in a signal handler.
class StopRequest {
 public:
  /// Installs the handlers. Ignores SIGPIPE, so that writing to a closed pipe fails with an error.
  static void install();
  /// True from the first request on.
  static const std::atomic<bool>& stop() noexcept;
  /// True from the second request on, or from the first one after main_part_is_over(): the program
  /// then skips its remaining work.
  static const std::atomic<bool>& hurry() noexcept;
  /// Declares that only evaluation remains, which a single request skips.
  static void main_part_is_over() noexcept;
  /// Installs SIGUSR1 as the emergency stop and SIGUSR2 as the signal of a dead-man's switch.
  static void install_switches();
  /// SIGUSR1 presses it; other sources call request_emergency().
  static servo::EmergencyStop& emergency() noexcept;
  static const servo::DeadManSignal& dead_man() noexcept;
  /// Presses the emergency stop and requests the end of the program, which skips its remaining
  /// work.
  static void request_emergency(servo::EmergencySource source) noexcept;
  /// Counts one request, as a signal does; for a parent that has closed standard input.
  static void request() noexcept;
};

}  // namespace forcegrid::cli
