// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/wrist_motion.h"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

#include "device_emulator/hand_motion.h"

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;

constexpr double kWristCircle_rad = 2.0 * std::numbers::pi;
constexpr double kWristFadeIn_s = 1.0;
constexpr double kTurnShare = 1.0 / 3.0;
constexpr double kTurn_Hz[3] = {0.31, 0.23, 0.17};
constexpr double kTwist_rad = 1.0;
constexpr double kTwistPeriod_s = 4.0;

}  // namespace

WristMotionKind parse_wrist_motion(std::string_view name) {
  if (name == "still") {
    return WristMotionKind::kStill;
  }
  if (name == "turn") {
    return WristMotionKind::kTurn;
  }
  if (name == "twist") {
    return WristMotionKind::kTwist;
  }
  throw std::invalid_argument("wrist motion '" + std::string(name) +
                              "' is unknown; use still, turn or twist");
}

WristMotion::WristMotion(WristMotionKind kind, const Vector3d& rest_rad, const Vector3d& reach_rad,
                         std::vector<PathPoint> path)
    : kind_(kind), rest_rad_(rest_rad), reach_rad_(reach_rad) {
  if (!path.empty() && path.front().gimbal_rad) {
    path_ = std::move(path);
  }
}

Vector3d WristMotion::angle_rad(double time_s) const noexcept {
  if (!path_.empty()) {
    return gimbal_along(path_, time_s);
  }
  if (!(time_s > 0.0)) {
    return rest_rad_;
  }
  Vector3d turned_rad = Vector3d::Zero();
  if (kind_ == WristMotionKind::kTurn) {
    for (int i = 0; i < 3; ++i) {
      turned_rad[i] =
          kTurnShare * reach_rad_[i] * std::sin(kWristCircle_rad * kTurn_Hz[i] * time_s);
    }
  } else if (kind_ == WristMotionKind::kTwist) {
    turned_rad[2] = kTwist_rad * std::sin(kWristCircle_rad * time_s / kTwistPeriod_s);
  }
  return rest_rad_ + minimum_jerk(time_s / kWristFadeIn_s) * turned_rad;
}

}  // namespace forcegrid::emulator
