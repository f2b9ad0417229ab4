#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/recording.h"

namespace forcegrid::tools {

/// What was drawn, and what the whole recording says.
struct RecordingPlot {
  RecordingHeader header;
  double duration_s = 0.0;
  std::uint64_t missed_deadlines = 0;
  std::uint64_t cycles_lost = 0;  ///< gaps in the cycles' numbers
  double period_max_us = 0.0;
  double force_max_N = 0.0;  ///< sent
  std::vector<std::string> files;
};

/// Draws `folder`/recording.svg and .png: position, force asked and sent, period with wake-up and
/// compute time, ages of report and sample, work on the hand, over time. Each point stands for a
/// span of cycles, see recording.csv: of times and ages the worst in it, else its first.
/// @throws Hdf5Error for an unreadable file, std::runtime_error when the pictures can't be made.
/// Real-time: no; memory does not grow with the recording. Threads: any, one reader each.
RecordingPlot plot_recording(const Hdf5Reader& reader, const std::string& folder);

}  // namespace forcegrid::tools
