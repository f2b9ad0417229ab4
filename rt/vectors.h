// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

namespace forcegrid::rt {

/// Three numbers as profiles, messages and records hold them, as a vector. Real-time: yes.
inline Eigen::Vector3d to_vector(const std::array<double, 3>& axes) noexcept {
  return {axes[0], axes[1], axes[2]};
}

/// And back. Real-time: yes.
inline std::array<double, 3> to_array(const Eigen::Vector3d& vector) noexcept {
  return {vector.x(), vector.y(), vector.z()};
}

}  // namespace forcegrid::rt
