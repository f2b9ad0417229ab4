// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "paper/recorded_motion.h"

namespace forcegrid::paper {

/// The paper's method with one resolution and one distance of influence on one motion.
struct ResolutionRow {
  std::string motion;
  int vertices = 0;                  ///< along each axis
  double radius_m = 0.0;             ///< r
  double radius_of_workspace = 0.0;  ///< r over the workspace's x extent; the paper's is 1/6
  /// Ratio of r to the longest travel between two answers; the paper's: 2 to 3.
  double radius_over_travel = 0.0;
  double spacing_over_radius = 0.0;  ///< mean distance of vertices over r; the paper's: 0.1 to 0.2
  double rms_error_percent = 0.0;    ///< after the first second
  double unknown_percent =
      0.0;               ///< share of the cycles in which no vertex around the tool had a force yet
  double fill_us = 0.0;  ///< to spread a sample over all vertices within r, median
  double memory_MB = 0.0;
};

/// Evaluates every resolution with every r on the recorded motions.
std::vector<ResolutionRow> sweep_resolutions(const std::vector<const RecordedMotion*>& motions,
                                             const PaperOptions& options);

}  // namespace forcegrid::paper
