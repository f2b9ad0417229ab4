// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "simulator/kernels/lanes.h"

// Conversions between the kernels' SIMD lanes and Eigen. Real-time: yes.
namespace forcegrid::simulator::kernels {

inline Eigen::Vector3d to_vector(const Precise& precise) noexcept {
  return {precise.xyz[0], precise.xyz[1], precise.xyz[2]};
}

inline Precise to_precise(const Eigen::Vector3d& vector) noexcept {
  return {Double4{vector.x(), vector.y(), vector.z(), 0.0}};
}

/// Lane 0: the position x.
inline Eigen::Vector3d position_of(const Lanes& lanes) noexcept {
  return {lanes.component[0][0], lanes.component[1][0], lanes.component[2][0]};
}

/// Lanes 1 to 3: S, row c, column j being dx_c / dP_j.
inline Eigen::Matrix3d sensitivity_of(const Lanes& lanes) noexcept {
  Eigen::Matrix3d sensitivity;
  for (int c = 0; c < 3; ++c) {
    for (int j = 0; j < 3; ++j) {
      sensitivity(c, j) = static_cast<double>(lanes.component[c][1 + j]);
    }
  }
  return sensitivity;
}

}  // namespace forcegrid::simulator::kernels
