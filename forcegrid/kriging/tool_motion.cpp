// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/tool_motion.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::kriging {
namespace {

constexpr double kVelocityFilter_s = 0.010;
constexpr double kLongestStep_s = 0.1;
constexpr double kNewInterval = 0.2;  // share of the newest interval in the sample period
constexpr double kShortestInterval_s = 1e-3;
constexpr double kLongestInterval_s = 0.2;

}  // namespace

bool ToolMotion::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    return false;
  }
  const double dt_s = time_s - time_s_;
  if (observed_ && dt_s > 0.0 && dt_s < kLongestStep_s) {
    const Eigen::Vector3d velocity_W = (position_W - position_W_) / dt_s;
    velocity_W_ += dt_s / (dt_s + kVelocityFilter_s) * (velocity_W - velocity_W_);
  } else if (!observed_ || dt_s != 0.0) {
    velocity_W_.setZero();
  }
  observed_ = true;
  time_s_ = time_s;
  position_W_ = position_W;
  return true;
}

void ToolMotion::sample_arrived() noexcept {
  if (!observed_) {
    return;
  }
  const double interval_s =
      std::clamp(time_s_ - last_arrival_s_, kShortestInterval_s, kLongestInterval_s);
  sample_period_s_ += kNewInterval * (interval_s - sample_period_s_);
  last_arrival_s_ = time_s_;
}

}  // namespace forcegrid::kriging
