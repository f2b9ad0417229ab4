// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rt/percentiles.h"
#include "servo_loop/cycle_record.h"

namespace forcegrid::tools {

/// Facts of a run that a dashboard shows besides its cycles.
struct DashboardTitle {
  std::string device, scene, method;
  std::vector<std::string> candidates;  ///< of the rendered method, an ensemble
  double rate_Hz = 500.0;
};

/// The picture of a running loop, in lines of text. Threads: one at a time.
class DashboardPicture {
 public:
  explicit DashboardPicture(DashboardTitle title);

  void add(const servo::CycleRecord& cycle);
  /// A message of the program; the newest one is shown.
  void note(const std::string& words);

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

}  // namespace forcegrid::tools
