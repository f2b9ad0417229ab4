#pragma once

#include <Eigen/Core>
#include <vector>

namespace forcegrid::tools {

/// Where something was, over time.
struct TimedPath {
  std::vector<double> time_s;  ///< rising
  std::vector<Eigen::Vector3d> position_m;

  /// On the straight line between the points around `at_s`; the first or last beyond the ends.
  Eigen::Vector3d at(double at_s) const;
};

/// How far one path is from another, once shifted in time so that they fit best.
struct PathComparison {
  double lag_s = 0.0;  ///< the follower's time at the leader's first point
  double rms_m = 0.0;
  double max_m = 0.0;
};

/// Looks for the lag, from the follower's first point on, at which the RMS distance of the two over
/// the leader's duration is least, to a millisecond.
/// @throws std::invalid_argument for a path of fewer than two points, or a follower shorter than
/// the
///         leader.
/// Real-time: no. Threads: any.
PathComparison compare_paths(const TimedPath& leader, const TimedPath& follower);

}  // namespace forcegrid::tools
