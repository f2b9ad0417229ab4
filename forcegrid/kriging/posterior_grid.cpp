// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/posterior_grid.h"

namespace forcegrid {

PosteriorGrid::PosteriorGrid(const Eigen::Vector3d& min_m, const Eigen::Vector3i& cells,
                             double spacing_m, std::size_t pool_blocks) noexcept
    : min_m_(min_m),
      cells_(cells),
      spacing_m_(spacing_m),
      inverse_per_m_(1.0 / spacing_m),
      last_(cells.cast<double>()),
      half_spacing_m_(static_cast<float>(0.5 * spacing_m)),
      storage_(cells.array() + 1, false, pool_blocks) {}

void PosteriorGrid::write(const Eigen::Vector3i& at, const Value& value,
                          std::uint32_t fit) noexcept {
  int units = 0;
  PosteriorVertex& v = storage_.touch(at.x(), at.y(), at.z() / kSegmentVertices, fit, units)
                           ->vertices[static_cast<std::size_t>(at.z() % kSegmentVertices)];
  const Eigen::Matrix3d& j = value.stiffness_N_per_m;
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    const int b = (axis + 1) % 3;
    const int c = (axis + 2) % 3;
    v.force_N[a] = static_cast<float>(value.force_N[axis]);
    v.normal_N_per_m[a] = static_cast<float>(j(axis, axis));
    v.shear_N_per_m[a] = static_cast<float>(0.5 * (j(b, c) + j(c, b)));
  }
  v.known = 1.0F;
  v.nearest_m = static_cast<float>(value.nearest_m);
  v.written = static_cast<float>(fit);
}

}  // namespace forcegrid
