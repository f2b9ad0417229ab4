// SPDX-License-Identifier: Apache-2.0
#include "calibration/strokes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace forcegrid::calibration {
namespace {

using Eigen::Vector3d;

constexpr double kRamp_s = 0.15;  // to the stroke's speed and from it
constexpr double kSwing_s = 4.0;
constexpr double kQuickSwing_s = 2.0;
constexpr double kSwingRamp_s = 0.7;

struct Speeds {
  double part;  // of the fastest
  int pairs;
};

std::vector<Speeds> speeds_of(const StrokePlan& plan) {
  return plan.quick ? std::vector<Speeds>{{0.3, 1}, {1.0, 2}}
                    : std::vector<Speeds>{{0.15, 1}, {0.4, 2}, {1.0, 3}};
}

// Of a stroke's cruise: no faster than two ramps without a cruise reach on the way.
double cruising_rad_per_s(double way_rad, double speed_rad_per_s) {
  return std::min(speed_rad_per_s, 0.5 * std::abs(way_rad) / kRamp_s);
}

double stroke_s(double way_rad, double speed_rad_per_s) {
  return std::abs(way_rad) / cruising_rad_per_s(way_rad, speed_rad_per_s) + kRamp_s;
}

// A stroke whose speed is v (1 - cos(pi t / T_r)) / 2 at first, then v, then the same ramp down.
void stroke(HeldArm& arm, const Vector3d& center_rad, int joint, double from_rad, double to_rad,
            double speed_rad_per_s) {
  const double way_rad = to_rad - from_rad;
  const double speed = std::copysign(cruising_rad_per_s(way_rad, speed_rad_per_s), way_rad);
  const double whole_s = stroke_s(way_rad, speed_rad_per_s);
  const double cruise_s = whole_s - 2.0 * kRamp_s;
  const double begin_s = arm.time_s();
  // Way, speed and acceleration `t_s` into the first ramp.
  const auto ramp = [&](double t_s) {
    const double phase = std::numbers::pi * t_s / kRamp_s;
    return Vector3d(0.5 * speed * (t_s - kRamp_s / std::numbers::pi * std::sin(phase)),
                    0.5 * speed * (1.0 - std::cos(phase)),
                    0.5 * speed * std::numbers::pi / kRamp_s * std::sin(phase));
  };
  for (double t_s = 0.0; t_s < whole_s;) {
    t_s = std::min(whole_s, arm.time_s() + arm.period_s() - begin_s);
    Vector3d motion(0.5 * speed * kRamp_s + speed * (t_s - kRamp_s), speed, 0.0);
    if (t_s < kRamp_s) {
      motion = ramp(t_s);
    } else if (t_s > kRamp_s + cruise_s) {
      const Vector3d back = ramp(whole_s - t_s);
      motion = Vector3d(way_rad - back[0], back[1], -back[2]);
    }
    JointTarget target{.angle_rad = center_rad};
    target.angle_rad[joint] = from_rad + motion[0];
    target.speed_rad_per_s[joint] = motion[1];
    target.acceleration_rad_per_s2[joint] = motion[2];
    arm.step(target);
  }
}

// q = c + A r(t) sin(2 pi f t), r a slow rise and fall.
void swing(HeldArm& arm, const Vector3d& center_rad, int joint, const StrokePlan& plan) {
  const double whole_s = plan.quick ? kQuickSwing_s : kSwing_s;
  const double omega = 2.0 * std::numbers::pi * plan.swing_Hz;
  const double begin_s = arm.time_s();
  for (double t_s = 0.0; t_s < whole_s;) {
    t_s = arm.time_s() + arm.period_s() - begin_s;
    const double edge_s = std::clamp(std::min(t_s, whole_s - t_s), 0.0, kSwingRamp_s);
    const double phase = std::numbers::pi * edge_s / kSwingRamp_s;
    const double size_rad = plan.swing_rad * 0.5 * (1.0 - std::cos(phase));
    JointTarget target{.angle_rad = center_rad};
    target.angle_rad[joint] += size_rad * std::sin(omega * t_s);
    target.speed_rad_per_s[joint] = size_rad * omega * std::cos(omega * t_s);
    target.acceleration_rad_per_s2[joint] = -size_rad * omega * omega * std::sin(omega * t_s);
    arm.step(target);
  }
}

}  // namespace

void make_strokes(HeldArm& arm, const Vector3d& center_rad, int joint, const StrokePlan& plan) {
  const double low_rad = center_rad[joint] - plan.amplitude_rad;
  const double high_rad = center_rad[joint] + plan.amplitude_rad;
  stroke(arm, center_rad, joint, center_rad[joint], low_rad, plan.fastest_rad_per_s);
  for (const Speeds& one : speeds_of(plan)) {
    for (int pair = 0; pair < one.pairs; ++pair) {
      stroke(arm, center_rad, joint, low_rad, high_rad, one.part * plan.fastest_rad_per_s);
      stroke(arm, center_rad, joint, high_rad, low_rad, one.part * plan.fastest_rad_per_s);
    }
  }
  stroke(arm, center_rad, joint, low_rad, center_rad[joint], plan.fastest_rad_per_s);
  swing(arm, center_rad, joint, plan);
}

double strokes_s(const StrokePlan& plan) {
  double time_s = 2.0 * stroke_s(plan.amplitude_rad, plan.fastest_rad_per_s) +
                  (plan.quick ? kQuickSwing_s : kSwing_s);
  for (const Speeds& one : speeds_of(plan)) {
    time_s +=
        2.0 * one.pairs * stroke_s(2.0 * plan.amplitude_rad, one.part * plan.fastest_rad_per_s);
  }
  return time_s;
}

}  // namespace forcegrid::calibration
