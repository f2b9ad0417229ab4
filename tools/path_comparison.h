// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace forcegrid::tools {

/// Positions over time.
struct TimedPath {
  std::vector<double> time_s;  ///< rising
  std::vector<Eigen::Vector3d> position_m;

  /// Linear interpolation at `at_s` [s]; the first or last point outside the path's times.
  Eigen::Vector3d at(double at_s) const;
};

/// Distance of two paths after shifting one in time for the best fit.
struct PathComparison {
  double lag_s = 0.0;  ///< follower's time at the leader's first point
  double rms_m = 0.0;
  double max_m = 0.0;
};

/// Finds the lag, at or after the follower's first point, with the least RMS distance over the
/// leader's duration. The lag is accurate to 1 ms.
/// @throws std::invalid_argument for a path of fewer than two points, or a follower shorter than
///         the leader.
/// Real-time: no. Threads: any.
PathComparison compare_paths(const TimedPath& leader, const TimedPath& follower);

}  // namespace forcegrid::tools
