// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <string>

#include "servo_loop/dead_man.h"
#include "servo_loop/emergency_stop.h"

namespace forcegrid::cli {

/// Exit status of a program that `signal` ended: 128 + its number, as shells report it.
constexpr int status_after(int signal) noexcept { return 128 + signal; }

/// Requests to end this process: SIGINT (Ctrl-C), SIGTERM and SIGHUP. Whatever work remains is
/// skipped.
/// SIGUSR1 and SIGUSR2 are switches of the device's user.
/// Threads: any thread may read. The flags are lock-free and safe in a signal handler.
class StopRequest {
 public:
  /// Installs the handlers. Ignores SIGPIPE, so that writing to a closed pipe fails with an error.
  static void install();
  /// The first of those signals that came; 0: none did.
  static int signal() noexcept;
  /// Its name: "SIGINT"; empty: none came.
  static std::string signal_name();
  /// Waits until such a signal has come, or wake() is called. One thread at a time.
  static void wait_for_signal() noexcept;
  /// Ends wait_for_signal() without a signal.
  static void wake() noexcept;
  /// True from the first request on, of a signal or of the program itself.
  static const std::atomic<bool>& stop() noexcept;
  /// Installs SIGUSR1 as the emergency stop and SIGUSR2 as the signal of a dead-man's switch.
  static void install_switches();
  /// SIGUSR1 presses it; other sources call request_emergency().
  static servo::EmergencyStop& emergency() noexcept;
  static const servo::DeadManSignal& dead_man() noexcept;
  /// Presses the emergency stop and requests the end of the program.
  static void request_emergency(servo::EmergencySource source) noexcept;
  /// Requests the end without a signal: the program itself wants to end.
  static void request() noexcept;
  /// Takes back what request() asked for: another run begins in this program. A signal and an
  /// emergency stop remain.
  static void forget() noexcept;
};

}  // namespace forcegrid::cli
