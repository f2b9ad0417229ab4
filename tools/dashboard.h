#pragma once

#include <atomic>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>

#include "servo_loop/cycle_record.h"
#include "tools/dashboard_picture.h"

namespace forcegrid::tools {

/// Draws a DashboardPicture on a terminal five times a second, on the alternate screen, with plain
/// escape codes of ECMA-48 (any terminal, tmux, ssh). The terminal is as before when this object is
/// gone, and also after Ctrl-Z and after signals that end the process at once (SIGSEGV, SIGABRT and
/// the like); only SIGKILL can't be answered (`reset` mends that). Nothing is set but screen and
/// cursor, and no key is read.
/// Real-time: add() takes a mutex; for telemetry's thread, never for the servo's.
/// Threads: add() and note() from any.
class Dashboard {
 public:
  /// @throws std::runtime_error with the remedy where `out` is no terminal that can do it. At most
  ///         one at a time.
  Dashboard(std::FILE* out, DashboardTitle title);
  /// Restores the terminal, and prints the notes that were taken meanwhile.
  ~Dashboard();
  Dashboard(const Dashboard&) = delete;
  Dashboard& operator=(const Dashboard&) = delete;

  /// Refuses what the constructor would, before a run is set up.
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
