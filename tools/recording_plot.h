// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/recording.h"

namespace forcegrid::tools {

/// Files drawn, and figures of the whole recording.
struct RecordingPlot {
  RecordingHeader header;
  double duration_s = 0.0;
  std::uint64_t missed_deadlines = 0;
  std::uint64_t cycles_lost = 0;  ///< gaps in the cycle numbers
  double period_max_us = 0.0;
  double force_max_N = 0.0;  ///< sent
  std::vector<std::string> files;
};

/// Draws `folder`/recording.svg and .png over time: position, force asked for and sent, period with
/// wake-up latency and compute time, ages of report and sample, and work on the hand. Each point
/// stands for a span of cycles (see recording.csv). Times and ages are the worst of the span, other
/// values its first.
/// @throws Hdf5Error for an unreadable file, std::runtime_error if the pictures can't be made.
/// Real-time: no. Memory does not grow with the recording. Threads: any, with one reader per
/// thread.
RecordingPlot plot_recording(const Hdf5Reader& reader, const std::string& folder);

}  // namespace forcegrid::tools
