// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/tool_touch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "contact/distance.h"
#include "rt/vectors.h"

namespace forcegrid::servo {
namespace {

// Until a force that this loop computes now acts at both ends, and is replaced.
constexpr double kCyclesAhead = 3.0;

// 1 below `begin`, 0 above `end`.
double falling(double value, double begin, double end) noexcept {
  return std::clamp((end - value) / (end - begin), 0.0, 1.0);
}

}  // namespace

double largest_tool_stiffness_N_per_m(const profiles::DeviceProfile& profile, double rate_Hz) {
  const double bus_frame_s = 1e-6 * profile.usb.frame_period_us;
  return profile.light_hand.damping_N_s_per_m / (3.0 / rate_Hz + 2.0 * bus_frame_s);
}

ToolTouch::ToolTouch(const ToolTouchOptions& options)
    : options_(options),
      shape_(options.shape.value_or(contact::ToolShape::sphere(ToolTouchOptions::kPointRadius_m))) {
  if (options.exchange != nullptr && options.tool >= options.exchange->tools()) {
    throw std::invalid_argument("tool touch: the tool's place is beyond those of the exchange");
  }
  if (!(options.stiffness_N_per_m >= 0.0 && std::isfinite(options.stiffness_N_per_m))) {
    throw std::invalid_argument("tool touch: use a stiffness of 0 N/m or more");
  }
}

Eigen::Vector3d ToolTouch::force_W(rt::TimePoint now, double elapsed_s,
                                   const Eigen::Vector3d& position_W, double own_gain) noexcept {
  Eigen::Vector3d sum_W = Eigen::Vector3d::Zero();
  if (options_.exchange == nullptr || options_.stiffness_N_per_m == 0.0 ||
      !position_W.allFinite()) {
    return sum_W;
  }
  for (std::size_t k = 0; k < options_.exchange->tools(); ++k) {
    Other& other = others_[k];
    if (k == options_.tool) {
      continue;
    }
    other.known = options_.exchange->fetch(options_.tool, k, other.place) || other.known;
    account(other, elapsed_s, position_W);
    if (other.presence < 1.0 || other.place.gain < 1.0 || own_gain < 1.0) {
      // A force that ramps in on tools that overlap already brings its energy with it.
      other.given_J = std::min(other.given_J, 0.0);
    }
    const double age_s =
        1e-9 * static_cast<double>(now.time_since_epoch().count() - other.place.time_ns);
    const Eigen::Vector3d between_W =
        between(other, age_s, elapsed_s, position_W, options_.tool < k);
    other.force_before_W = other.force_W;
    other.force_W = std::clamp(other.place.gain, 0.0, 1.0) * between_W;
    sum_W += other.force_W;
    options_.exchange->publish(options_.tool, k,
                               {.position_W_m = rt::to_array(position_W),
                                .time_ns = now.time_since_epoch().count(),
                                .force_W_N = rt::to_array(between_W),
                                .gain = own_gain,
                                .given_J = other.given_J});
  }
  last_position_W_ = position_W;
  has_position_ = true;
  cycles_touching_ += sum_W.isZero(0.0) ? 0 : 1;
  largest_force_N_ = std::max(largest_force_N_, sum_W.norm());
  return sum_W;
}

// On this tool, without either hand's gain.
// @param computes  whether this loop does; else it takes what the other one has said.
Eigen::Vector3d ToolTouch::between(Other& other, double age_s, double elapsed_s,
                                   const Eigen::Vector3d& position_W, bool computes) noexcept {
  const double fade = other.known ? falling(age_s, kOld_s, kTooOld_s) : 0.0;
  other.presence = fade > 0.0 ? std::min(1.0, other.presence + elapsed_s / kRampIn_s) : 0.0;
  other.overlaps = false;
  if (fade == 0.0) {
    other.gap_m = std::numeric_limits<double>::infinity();
    return Eigen::Vector3d::Zero();
  }
  const contact::ToolToTool pair =
      contact::nearest(shape_, position_W, shape_, rt::to_vector(other.place.position_W_m));
  other.overlaps = pair.gap_m < 0.0;
  if (!computes) {
    return -fade * other.presence * rt::to_vector(other.place.force_W_N);
  }
  if (!pair.normal_W.isZero(0.0)) {
    other.normal_W = pair.normal_W;
  }
  const double force_N = options_.stiffness_N_per_m * std::max(0.0, -pair.gap_m);
  const double opened_m = std::max(0.0, pair.gap_m - std::exchange(other.gap_m, pair.gap_m));
  const double scale =
      scale_for(other.given_J + other.place.given_J, force_N * opened_m, elapsed_s);
  return scale * fade * other.presence * force_N * other.normal_W;
}

// @param given_J  so far. @param opening_J  that the force gives in a cycle like the last one.
double ToolTouch::scale_for(double given_J, double opening_J, double elapsed_s) const noexcept {
  const double cycles =
      elapsed_s > 0.0 ? kCyclesAhead + options_.transport_delay_s / elapsed_s : 0.0;
  const double ahead_J = cycles * opening_J;
  const double left_J = std::max(0.0, kBound_J - given_J);
  return falling(given_J, kAllowance_J, kBound_J) * (ahead_J > left_J ? left_J / ahead_J : 1.0);
}

// Before the force of this cycle is known. `overlaps` is of the last one.
void ToolTouch::account(Other& other, double elapsed_s,
                        const Eigen::Vector3d& position_W) noexcept {
  other.apart_s = other.overlaps ? 0.0 : other.apart_s + elapsed_s;
  if (!has_position_ || elapsed_s <= 0.0 || other.apart_s >= kApart_s) {
    other.given_J = 0.0;
    return;
  }
  const double late = std::min(1.0, options_.transport_delay_s / elapsed_s);
  const Eigen::Vector3d acting_W = late * other.force_before_W + (1.0 - late) * other.force_W;
  other.given_J += share_ * acting_W.dot(position_W - last_position_W_);
  if (other.given_J > 0.0) {
    other.given_J = std::max(0.0, other.given_J - kForgiven_W * elapsed_s);
  }
}

}  // namespace forcegrid::servo
