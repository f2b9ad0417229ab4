// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace forcegrid::rt {

/// [rad] The rotation vector that turns the unit quaternion `from` into `to` the shorter way,
/// expressed in the frame that both rotate into: to = exp(theta) from, length 0 to pi.
/// Real-time: no allocation, lock or throw. Threads: any.
[[nodiscard]] inline Eigen::Vector3d rotation_vector_rad(const Eigen::Quaterniond& from,
                                                         const Eigen::Quaterniond& to) noexcept {
  const Eigen::Quaterniond turn = to * from.conjugate();
  const double side = turn.w() < 0.0 ? -1.0 : 1.0;  // q and -q are one rotation
  const double sine = turn.vec().norm();
  const double angle_rad = 2.0 * std::atan2(sine, side * turn.w());
  // 2 is the limit of angle / sine at no rotation.
  return side * (sine > 0.0 ? angle_rad / sine : 2.0) * turn.vec();
}

}  // namespace forcegrid::rt
