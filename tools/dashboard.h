// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>

#include "servo_loop/cycle_record.h"
#include "tools/dashboard_picture.h"

namespace forcegrid::tools {

/// Draws a DashboardPicture on a terminal five times per second, on the alternate screen, with
/// plain escape codes of ECMA-48 (any terminal, tmux, ssh). Changes only screen and cursor, and
/// reads no key. The destructor restores the terminal, as do the handlers of Ctrl-Z and of signals
/// that end the process at once (SIGSEGV, SIGABRT and others). After SIGKILL, run `reset`.
/// Real-time: no. add() locks a mutex; call it from telemetry's thread, never from the servo's.
/// Threads: add() and note() from any.
class Dashboard {
 public:
  /// @throws std::runtime_error with the remedy if `out` is not a terminal with these codes. At
  ///         most one dashboard at a time.
  Dashboard(std::FILE* out, DashboardTitle title);
  /// Restores the terminal and prints the notes that arrived meanwhile.
  ~Dashboard();
  Dashboard(const Dashboard&) = delete;
  Dashboard& operator=(const Dashboard&) = delete;

  /// Throws as the constructor does; for a check before a run is set up.
  static void check(std::FILE* out);

  void add(const servo::CycleRecord& cycle);
  void note(const std::string& text);

 private:
  void draw();

  std::FILE* out_;
  std::mutex mutex_;
  DashboardPicture picture_;
  std::string notes_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace forcegrid::tools
