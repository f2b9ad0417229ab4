// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/column_cut.h"

#include <cmath>
#include <vector>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

bool in_column(const Vector3d& position_W, const ColumnCut& cut) {
  return std::abs(position_W.x() - cut.centre_W.x()) < cut.half_width_m &&
         std::abs(position_W.y() - cut.centre_W.y()) < cut.half_width_m;
}

}  // namespace

SpringMesh with_cut(const SpringMesh& mesh, const ColumnCut& cut) {
  if (!mesh.load_W_N.empty()) {
    throw Error("an object that dead loads keep in its shape (pre-strain, gravity) can't be cut");
  }
  const auto at = [&](std::int32_t vertex) -> const Vector3d& {
    return mesh.rest_position_W[static_cast<std::size_t>(vertex)];
  };
  const auto crosses = [&](std::int32_t a, std::int32_t b) {
    return in_column(at(a), cut) != in_column(at(b), cut) &&
           0.5 * (at(a).z() + at(b).z()) > cut.centre_W.z() - cut.depth_m;
  };
  SpringMesh result = mesh;
  for (Spring& spring : result.springs) {
    if (crosses(spring.a, spring.b)) {
      spring.stiffness_N_per_m *= kSevered;
      spring.severed = true;
    }
  }
  std::erase_if(result.triangles, [&](const auto& corner) {
    return crosses(corner[0], corner[1]) || crosses(corner[1], corner[2]) ||
           crosses(corner[2], corner[0]);
  });
  return result;
}

}  // namespace forcegrid::simulator
