// SPDX-License-Identifier: Apache-2.0
#include "tools/path_comparison.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace forcegrid::tools {
namespace {

constexpr double kCoarse_s = 0.02;
constexpr double kFine_s = 0.001;
constexpr int kInstants = 400;  // number of instants compared during the search for the lag

PathComparison at_lag(const TimedPath& leader, const TimedPath& follower, double lag_s,
                      int instants) {
  const double begin_s = leader.time_s.front();
  const double duration_s = leader.time_s.back() - begin_s;
  PathComparison result;
  result.lag_s = lag_s;
  double sum = 0.0;
  for (int i = 0; i < instants; ++i) {
    const double since_s = duration_s * i / (instants - 1);
    const double distance_m =
        (leader.at(begin_s + since_s) - follower.at(follower.time_s.front() + lag_s + since_s))
            .norm();
    sum += distance_m * distance_m;
    result.max_m = std::max(result.max_m, distance_m);
  }
  result.rms_m = std::sqrt(sum / instants);
  return result;
}

PathComparison best_between(const TimedPath& leader, const TimedPath& follower, double low_s,
                            double high_s, double step_s) {
  PathComparison best;
  best.rms_m = std::numeric_limits<double>::infinity();
  for (int i = 0; low_s + i * step_s <= high_s; ++i) {
    const PathComparison one = at_lag(leader, follower, low_s + i * step_s, kInstants);
    best = one.rms_m < best.rms_m ? one : best;
  }
  return best;
}

}  // namespace

Eigen::Vector3d TimedPath::at(double at_s) const {
  const auto after = std::upper_bound(time_s.begin(), time_s.end(), at_s);
  if (after == time_s.begin()) {
    return position_m.front();
  }
  if (after == time_s.end()) {
    return position_m.back();
  }
  const auto i = static_cast<std::size_t>(after - time_s.begin());
  const double fraction = (at_s - time_s[i - 1]) / (time_s[i] - time_s[i - 1]);
  return position_m[i - 1] + fraction * (position_m[i] - position_m[i - 1]);
}

PathComparison compare_paths(const TimedPath& leader, const TimedPath& follower) {
  if (leader.time_s.size() < 2 || follower.time_s.size() < 2) {
    throw std::invalid_argument("a path of fewer than two points can't be compared");
  }
  const double slack_s = (follower.time_s.back() - follower.time_s.front()) -
                         (leader.time_s.back() - leader.time_s.front());
  if (slack_s < 0.0) {
    throw std::invalid_argument("the follower's path is shorter than the one to follow");
  }
  const PathComparison coarse = best_between(leader, follower, 0.0, slack_s, kCoarse_s);
  const PathComparison fine =
      best_between(leader, follower, std::max(0.0, coarse.lag_s - kCoarse_s),
                   std::min(slack_s, coarse.lag_s + kCoarse_s), kFine_s);
  return at_lag(leader, follower, fine.lag_s, static_cast<int>(leader.time_s.size()));
}

}  // namespace forcegrid::tools
