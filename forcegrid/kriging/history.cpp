// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/history.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {

ToolHistory::ToolHistory(const TimeConstants& time_constants_s)
    : time_constants_s_(Eigen::Map<const PerLag>(time_constants_s.data())),
      per_time_constant_Hz_(time_constants_s_.inverse()),
      shortest_s_(time_constants_s_.minCoeff()),
      entries_(kEntries) {}

// exp(-dt / tau_j), from that of the last exact period where dt is near it, as in a servo's cycles.
ToolHistory::PerLag ToolHistory::kept_after(double dt_s) noexcept {
  constexpr double kNear = 0.01;  // the cube of it, over six, is what the series leaves out
  if (!(std::abs(period_s_ - dt_s) < kNear * shortest_s_)) {
    period_s_ = dt_s;
    kept_after_period_ = (-dt_s * per_time_constant_Hz_).exp();
    return kept_after_period_;
  }
  const PerLag x = (period_s_ - dt_s) * per_time_constant_Hz_;
  return kept_after_period_ * (1.0 + x * (1.0 + 0.5 * x));
}

void ToolHistory::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  if (!std::isfinite(time_s) || !position_W.allFinite() || (count_ > 0 && time_s <= time_s_)) {
    return;
  }
  if (count_ > 0 && time_s - time_s_ > kLongestGap_s) {
    count_ = 0;
  }
  if (count_ == 0) {
    lags_.fill(PerLag::Zero());
  } else {
    // On a straight path of velocity v the lag tends to v tau.
    const double dt_s = time_s - time_s_;
    const Eigen::Vector3d velocity = (position_W - position_W_) / dt_s;
    const PerLag kept = kept_after(dt_s);
    const PerLag gained_s = (1.0 - kept) * time_constants_s_;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      lags_[axis] = kept * lags_[axis] + gained_s * velocity[static_cast<int>(axis)];
    }
  }
  time_s_ = time_s;
  position_W_ = position_W;
  // The newest entry moves with the present while it is less than kSpacing_s after the one before.
  const bool replace = count_ > 1 && time_s - entry(1).time_s < kSpacing_s;
  if (!replace) {
    newest_ = (newest_ + 1) % kEntries;
    count_ = std::min(count_ + 1, kEntries);
  }
  Entry& now = entries_[newest_];
  now.time_s = time_s;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (int j = 0; j < kLags; ++j) {
      now.lags(static_cast<int>(axis), j) = static_cast<float>(lags_[axis][j]);
    }
  }
}

bool ToolHistory::find(double time_s, Lags& lags) const noexcept {
  if (count_ == 0 || !(time_s <= entry(0).time_s) || !(time_s >= entry(count_ - 1).time_s)) {
    return false;
  }
  std::size_t later = 0;             // the oldest entry known to be at or after time_s
  std::size_t earlier = count_ - 1;  // the newest entry known to be at or before it
  while (earlier - later > 1) {
    const std::size_t middle = (earlier + later) / 2;
    (entry(middle).time_s >= time_s ? later : earlier) = middle;
  }
  const Entry& a = entry(earlier);
  const Entry& b = entry(later);
  const double span_s = b.time_s - a.time_s;
  const float t = span_s > 0.0 ? static_cast<float>((time_s - a.time_s) / span_s) : 0.0F;
  lags = a.lags + t * (b.lags - a.lags);
  return true;
}

}  // namespace forcegrid
