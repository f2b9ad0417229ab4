// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/tool_path.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <iterator>

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kLongestGap = 0.5;     // of the window
constexpr double kTimeRounding = 1e-6;  // of the window

}  // namespace

void ToolPath::add(double time_s, const Vector3d& position_W) {
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    return;
  }
  if (!places_.empty() && time_s <= places_.back().time_s) {
    if (time_s == places_.back().time_s) {
      return;
    }
    places_.clear();
  }
  if (places_.size() == kMostPositions) {
    places_.pop_front();
  }
  places_.push_back({time_s, position_W});
}

void ToolPath::forget_before(double time_s) noexcept {
  const double needed_s = time_s - (1.0 + kLongestGap) * kWindow_s;
  while (places_.size() > 2 && places_[1].time_s < needed_s) {
    places_.pop_front();
  }
}

ToolPath::Iterator ToolPath::first_from(double time_s) const noexcept {
  return std::lower_bound(places_.begin(), places_.end(), time_s,
                          [](const Place& place, double t_s) { return place.time_s < t_s; });
}

Vector3d ToolPath::at(double time_s) const noexcept {
  assert(!places_.empty());
  const double t_s = std::clamp(time_s, places_.front().time_s, places_.back().time_s);
  const double end_s = std::min(t_s + 0.5 * kWindow_s, places_.back().time_s);
  const double begin_s = end_s - kWindow_s;
  const double slack_s = kTimeRounding * kWindow_s;
  double before_s = begin_s;
  double longest_gap_s = 0.0;
  std::size_t count = 0;
  Matrix3d normal = Matrix3d::Zero();
  Matrix3d right = Matrix3d::Zero();
  for (Iterator i = first_from(begin_s - slack_s);
       i != places_.end() && i->time_s <= end_s + slack_s; ++i) {
    const double s = (i->time_s - t_s) / kWindow_s;
    const Vector3d powers(1.0, s, s * s);
    normal += powers * powers.transpose();
    right += powers * i->position_W.transpose();
    longest_gap_s = std::max(longest_gap_s, i->time_s - before_s);
    before_s = i->time_s;
    ++count;
  }
  longest_gap_s = std::max(longest_gap_s, end_s - before_s);
  if (count >= kFewestPositions && longest_gap_s <= kLongestGap * kWindow_s) {
    return normal.ldlt().solve(right).row(0).transpose();
  }
  const Iterator next = first_from(t_s);
  if (next == places_.begin()) {
    return next->position_W;
  }
  const Iterator last = std::prev(next);
  const double share = (t_s - last->time_s) / (next->time_s - last->time_s);
  return last->position_W + share * (next->position_W - last->position_W);
}

}  // namespace forcegrid::simulator
