// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/recording.h"

namespace forcegrid::tools {

/// What to draw of a recording, and how.
struct RecordingPlotOptions {
  /// [s] in the recording's own time, which is zero at its start; unset: all of it.
  std::optional<double> from_s;
  std::optional<double> to_s;
  /// Instead of both: from just before the first contact to just after the last.
  bool contact_only = false;
  std::vector<std::string> formats{"svg", "png"};  ///< svg, png, pdf
  int width_px = 1000;                             ///< of a pdf: 96 to an inch
};

/// Files drawn, and figures of the whole recording.
struct RecordingPlot {
  RecordingHeader header;
  double duration_s = 0.0;
  std::uint64_t missed_deadlines = 0;
  std::uint64_t cycles_lost = 0;  ///< gaps in the cycle numbers
  double period_max_us = 0.0;
  double force_max_N = 0.0;  ///< sent
  /// [s] The first and the last cycle in contact, in the recording's time; unset: there is none.
  std::optional<double> contact_from_s;
  std::optional<double> contact_to_s;
  double drawn_from_s = 0.0;  ///< the part that was drawn
  double drawn_to_s = 0.0;
  std::vector<std::string> files;
};

/// Draws `folder`/recording.svg and .png (or the formats asked for) over time: position, force
/// asked for and sent, period with wake-up latency and compute time, ages of report and sample, and
/// work on the hand. Each point stands for a span of cycles (see recording.csv). Times and ages are
/// the worst of the span, other values its first. The axes fit the part that is drawn.
/// @throws Hdf5Error for an unreadable file, std::runtime_error if there is nothing to draw or the
///         pictures can't be made.
/// Real-time: no. Memory does not grow with the recording. Threads: any, with one reader per
/// thread.
RecordingPlot plot_recording(const Hdf5Reader& reader, const std::string& folder,
                             const RecordingPlotOptions& options = {});

}  // namespace forcegrid::tools
