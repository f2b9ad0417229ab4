#pragma once

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "rt/percentiles.h"
#include "servo_loop/cycle_record.h"

namespace forcegrid::tools {

/// What a dashboard says of a run besides its cycles.
struct DashboardTitle {
  std::string device, scene, method;
  std::vector<std::string> members;  ///< of the rendered method
  double rate_Hz = 500.0;
};

/// The picture of a running loop, in lines of text. Threads: one at a time.
class DashboardPicture {
 public:
  explicit DashboardPicture(DashboardTitle title);

  void add(const servo::CycleRecord& cycle);
  /// What the program has to say; the newest is shown.
  void note(const std::string& text);

  static constexpr int kColumns = 80;
  static constexpr int kRows = 24;
  /// `rows` lines of at most `columns` characters of ASCII each, without newlines.
  std::vector<std::string> lines(int columns = kColumns, int rows = kRows) const;

 private:
  void add_second(const servo::CycleRecord& cycle);

  DashboardTitle title_;
  servo::CycleRecord newest_;
  std::int64_t first_ns_ = 0;
  std::uint64_t cycles_ = 0;
  std::uint64_t missed_ = 0;
  double force_max_N_ = 0.0;
  double work_J_ = 0.0;
  rt::Percentiles period_us_, wakeup_us_, compute_us_, report_age_us_, sample_age_ms_;
  std::vector<std::uint64_t> wakeup_bins_;
  std::int64_t second_begun_ns_ = 0;
  std::uint64_t second_cycles_ = 0;
  double rate_Hz_ = 0.0;  ///< over the last whole second
  std::string note_;
};

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
