// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/history.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {

ToolHistory::ToolHistory(const TimeConstants& time_constants_s)
    : time_constants_s_(time_constants_s), entries_(kEntries) {}

// exp(-dt / tau_j), from that of the last exact period where dt is near it, as in a servo's cycles.
double ToolHistory::kept_after(double dt_s, std::size_t j) noexcept {
  constexpr double kNear = 0.01;  // the cube of it, over six, is what the series leaves out
  Kept& known = kept_[j];
  const double x = (known.period_s - dt_s) / time_constants_s_[j];
  if (!(std::abs(x) < kNear)) {
    known = {dt_s, std::exp(-dt_s / time_constants_s_[j])};
    return known.kept;
  }
  return known.kept * (1.0 + x * (1.0 + 0.5 * x));
}

void ToolHistory::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  if (!std::isfinite(time_s) || !position_W.allFinite() || (count_ > 0 && time_s <= time_s_)) {
    return;
  }
  if (count_ > 0 && time_s - time_s_ > kLongestGap_s) {
    count_ = 0;
  }
  if (count_ == 0) {
    lags_.setZero();
  } else {
    // On a straight path of velocity v the lag tends to v tau.
    const double dt_s = time_s - time_s_;
    const Eigen::Vector3d velocity = (position_W - position_W_) / dt_s;
    for (std::size_t j = 0; j < kLags; ++j) {
      const double tau_s = time_constants_s_[j];
      const double kept = kept_after(dt_s, j);
      const int column = static_cast<int>(j);
      lags_.col(column) = kept * lags_.col(column) + (1.0 - kept) * tau_s * velocity;
    }
  }
  time_s_ = time_s;
  position_W_ = position_W;
  now_ = lags_.cast<float>();
  // The newest entry moves with the present while it is less than kSpacing_s after the one before.
  const bool replace = count_ > 1 && time_s - entry(1).time_s < kSpacing_s;
  if (!replace) {
    newest_ = (newest_ + 1) % kEntries;
    count_ = std::min(count_ + 1, kEntries);
  }
  entries_[newest_] = {time_s, now_};
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
