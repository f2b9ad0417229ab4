// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/wrist.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace forcegrid::emulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kCircle_rad = 2.0 * std::numbers::pi;

/// Elementary rotation about x, y or z (0, 1, 2), element by element.
Matrix3d elementary(int axis, double angle_rad) {
  const double c = std::cos(angle_rad);
  const double s = std::sin(angle_rad);
  Matrix3d rotation;
  if (axis == 0) {
    rotation << 1, 0, 0, 0, c, -s, 0, s, c;
  } else if (axis == 1) {
    rotation << c, 0, s, 0, 1, 0, -s, 0, c;
  } else {
    rotation << c, -s, 0, s, c, 0, 0, 0, 1;
  }
  return rotation;
}

}  // namespace

Vector3d Wrist::within_stops(const Vector3d& angle_rad) const noexcept {
  Vector3d result = angle_rad;
  for (std::size_t i = 0; i < 3; ++i) {
    double& angle = result[static_cast<Eigen::Index>(i)];
    angle = std::clamp(angle, gimbal_.joint_min_rad[i], gimbal_.joint_max_rad[i]);
  }
  return result;
}

Vector3d Wrist::joint_angle_rad(const std::array<std::int32_t, 6>& counts) const noexcept {
  Vector3d angle_rad = Vector3d::Zero();
  for (std::size_t i = 0; i < 3 && gimbal_.present; ++i) {
    const double turns =
        counts[static_cast<std::size_t>(gimbal_.counter[i])] / gimbal_.encoder_counts_per_turn[i];
    angle_rad[static_cast<Eigen::Index>(i)] = gimbal_.encoder_sign[i] * kCircle_rad * turns;
  }
  return angle_rad;
}

std::array<std::int64_t, 3> Wrist::encoder_positions(const Vector3d& angle_rad) const noexcept {
  std::array<std::int64_t, 3> positions{};
  for (std::size_t i = 0; i < 3 && gimbal_.present; ++i) {
    const double turns =
        gimbal_.encoder_sign[i] * angle_rad[static_cast<Eigen::Index>(i)] / kCircle_rad;
    positions[static_cast<std::size_t>(gimbal_.counter[i] - 3)] =
        std::llround(turns * gimbal_.encoder_counts_per_turn[i]);
  }
  return positions;
}

Matrix3d Wrist::tool_axes_D(const Vector3d& linkage_angle_rad,
                            const Vector3d& angle_rad) const noexcept {
  if (!gimbal_.present) {
    return Matrix3d::Identity();
  }
  Matrix3d axes = elementary(2, linkage_angle_rad[0]) *
                  elementary(1, 0.25 * kCircle_rad - linkage_angle_rad[2]);
  for (std::size_t i = 0; i < 3; ++i) {
    axes = axes * elementary(gimbal_.axis[i], angle_rad[static_cast<Eigen::Index>(i)]);
  }
  return axes;
}

Matrix3d Wrist::joint_axes_D(const Vector3d& linkage_angle_rad,
                             const Vector3d& angle_rad) const noexcept {
  Matrix3d frame = elementary(2, linkage_angle_rad[0]) *
                   elementary(1, 0.25 * kCircle_rad - linkage_angle_rad[2]);
  Matrix3d axes;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto joint = static_cast<Eigen::Index>(i);
    axes.col(joint) = frame.col(gimbal_.axis[i]);
    frame = frame * elementary(gimbal_.axis[i], angle_rad[joint]);
  }
  return axes;
}

}  // namespace forcegrid::emulator
