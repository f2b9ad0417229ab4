// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/hand_follower.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;

constexpr double kFollow_rad_per_s = 2.0 * std::numbers::pi * HandFollower::kBandwidth_Hz;
constexpr double kBack_m = 1e-7;  // a hand of 1 kN/m then jumps by 0.1 mN
constexpr double kBack_m_per_s = 1e-5;

Vector3d at_most(const Vector3d& vector, double length) noexcept {
  const double norm = vector.norm();
  return norm > length ? Vector3d(vector * (length / norm)) : vector;
}

// Moves on along the way to the goal, way_D from it, for `duration_s`.
void approach(double duration_s, double most_m_per_s, Vector3d& way_D, Vector3d& speed_D) noexcept {
  const int steps = static_cast<int>(std::clamp(
      std::ceil(duration_s / HandFollower::kStep_s - 1e-9), 0.0, double{HandFollower::kMostSteps}));
  const double step_s = steps > 0 ? std::min(duration_s / steps, HandFollower::kStep_s) : 0.0;
  for (int step = 0; step < steps; ++step) {
    const Vector3d wanted = -kFollow_rad_per_s * (kFollow_rad_per_s * way_D + 2.0 * speed_D);
    speed_D += step_s * at_most(wanted, HandFollower::kMost_m_per_s2);
    speed_D = at_most(speed_D, most_m_per_s);
    way_D += step_s * speed_D;
  }
}

}  // namespace

Vector3d HandFollower::update(rt::TimePoint now, const Vector3d& script_D,
                              const std::optional<Vector3d>& pointer_D) noexcept {
  const double passed_s = last_ ? std::max(0.0, rt::seconds(now - *last_)) : 0.0;
  const Vector3d old_script_D = last_ ? script_D_ : script_D;
  const Vector3d old_speed_D = script_speed_D_;
  if (passed_s > 0.0) {
    script_speed_D_ = (script_D - old_script_D) / passed_s;
  }
  last_ = now;
  script_D_ = script_D;
  if (!away_ && !pointer_D) {
    return script_D;
  }
  if (!away_) {
    away_ = true;
    target_D_ = old_script_D;
    speed_D_ = old_speed_D;
  }
  Vector3d way_D = target_D_ - (pointer_D ? *pointer_D : old_script_D);
  Vector3d speed_D = pointer_D ? speed_D_ : Vector3d(speed_D_ - old_speed_D);
  approach(passed_s, most_m_per_s_, way_D, speed_D);
  target_D_ = (pointer_D ? *pointer_D : script_D) + way_D;
  speed_D_ = pointer_D ? speed_D : Vector3d(speed_D + script_speed_D_);
  if (!pointer_D && way_D.norm() < kBack_m && speed_D.norm() < kBack_m_per_s) {
    away_ = false;
    return script_D;
  }
  return target_D_;
}

}  // namespace forcegrid::emulator
