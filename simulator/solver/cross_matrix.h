// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::simulator {

/// [v]x, with [v]x a = v x a. Real-time: no allocation, lock or throw. Threads: any.
inline Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) noexcept {
  Eigen::Matrix3d matrix;
  matrix << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return matrix;
}

}  // namespace forcegrid::simulator
