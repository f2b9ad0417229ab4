#pragma once

#include <atomic>

#include "servo_loop/dead_man.h"
#include "servo_loop/emergency_stop.h"

namespace forcegrid::cli {

/// Counts what asks this process to end: SIGINT (Ctrl-C), SIGTERM and SIGHUP each count one.
/// SIGUSR1 and SIGUSR2 are the switches of a device's user.
/// Threads: any may read; the flags are lock-free and safe in a signal handler.
class StopRequest {
 public:
  /// Installs the handlers. SIGPIPE is ignored: a closed pipe is an error of the write.
  static void install();
  /// True from the first request on.
  static const std::atomic<bool>& stop() noexcept;
  /// True from the second request on, or from the first one after main_part_is_over(): what is
  /// left to do is skipped, too.
  static const std::atomic<bool>& hurry() noexcept;
  /// What follows is only evaluation; one request is enough to skip it.
  static void main_part_is_over() noexcept;
  /// Installs SIGUSR1 as emergency stop and SIGUSR2 as the sign of a dead-man's switch.
  static void install_switches();
  /// Pressed by SIGUSR1; whoever else presses it calls request_emergency().
  static servo::EmergencyStop& emergency() noexcept;
  static const servo::DeadManSignal& dead_man() noexcept;
  /// Presses the emergency stop and asks to end, what is left to do skipped.
  static void request_emergency(servo::EmergencySource source) noexcept;
  /// As if a signal had come; for a parent that has closed standard input.
  static void request() noexcept;
};

}  // namespace forcegrid::cli
