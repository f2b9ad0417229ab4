// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// [m^3] that the mesh's triangles enclose, positive when they are seen from outside
/// counterclockwise: the divergence theorem.
inline double volume_m3(const SpringMesh& mesh) {
  double volume = 0.0;
  for (const auto& triangle : mesh.triangles) {
    const auto at = [&](std::size_t k) {
      return mesh.rest_position_W[static_cast<std::size_t>(triangle[k])];
    };
    volume += at(0).dot(at(1).cross(at(2))) / 6.0;
  }
  return volume;
}

}  // namespace forcegrid::simulator
