// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <string>

#include "device_session/device_session.h"

namespace forcegrid::session {

/// An emulated device in a process of its own, in a process group of its own: `forcegrid emulate`.
/// When this process ends in whatever way, the emulator goes on for kLinger_s without its host, so
/// that its summary shows what the firmware did to the motors, and ends by itself.
/// Real-time: no. Threads: one.
class EmulatorProcess {
 public:
  static constexpr double kLinger_s = 1.5;  ///< three times the firmware's watchdog

  /// Starts it and waits until it listens. @param profile name or file of the device's profile.
  /// @throws SessionError naming the reason.
  EmulatorProcess(const SessionOptions& options, const std::string& profile);
  /// Ends it: its summary has been written when this returns.
  ~EmulatorProcess();
  EmulatorProcess(const EmulatorProcess&) = delete;
  EmulatorProcess& operator=(const EmulatorProcess&) = delete;

  [[nodiscard]] const std::string& url() const noexcept { return url_; }

 private:
  void start(const SessionOptions& options, const std::string& profile);
  void end() noexcept;
  std::string first_line();

  pid_t pid_ = -1;
  int to_child_ = -1;
  int from_child_ = -1;
  std::string url_;
};

}  // namespace forcegrid::session
