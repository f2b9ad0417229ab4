// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/spreading_grid.h"

#include <tuple>

namespace forcegrid {
namespace {

// How many segments away from the vertex's own one a reach of `vertices` along z can touch.
int segments_for(int vertices) noexcept {
  return (vertices + kSegmentVertices - 1) / kSegmentVertices;
}

template <typename Visit>
void visit_segments(const GridGeometry& geometry, double reach_m, const Eigen::Vector3i& reach,
                    Visit visit) noexcept {
  const Eigen::Vector3d spacing_m = geometry.spacing_m();
  const int segments = segments_for(reach.z());
  for (int i = -reach.x(); i <= reach.x(); ++i) {
    for (int j = -reach.y(); j <= reach.y(); ++j) {
      const double xy2 = std::pow(i * spacing_m.x(), 2) + std::pow(j * spacing_m.y(), 2);
      for (int s = -segments; s <= segments; ++s) {
        // The vertex may be anywhere in its segment: this many cells away at least, ...
        const int cells = std::max(std::abs(s) * kSegmentVertices - (kSegmentVertices - 1), 0);
        if (xy2 + std::pow(cells * spacing_m.z(), 2) <= reach_m * reach_m) {
          visit(NeighbourSegment{static_cast<std::int16_t>(i), static_cast<std::int16_t>(j),
                                 static_cast<std::int16_t>(s)});
        }
      }
    }
  }
}

}  // namespace

Eigen::Vector3i fill_reach(const GridGeometry& geometry, double influence_radius_m,
                           int largest_reach) noexcept {
  const Eigen::Vector3d spacing_m = geometry.spacing_m();
  const double reach_m = influence_radius_m + 0.5 * spacing_m.norm();
  const Eigen::Array3d largest = geometry.cells.cast<double>().array().min(largest_reach);
  return (reach_m / spacing_m.array()).floor().min(largest).cast<int>();
}

Buffer<NeighbourSegment> neighbour_segments(const GridGeometry& geometry, double influence_radius_m,
                                            int largest_reach) noexcept {
  const Eigen::Vector3d spacing_m = geometry.spacing_m();
  const double reach_m = influence_radius_m + 0.5 * spacing_m.norm();
  const Eigen::Vector3i reach = fill_reach(geometry, influence_radius_m, largest_reach);
  std::size_t count = 0;
  visit_segments(geometry, reach_m, reach, [&](const NeighbourSegment&) { ++count; });
  Buffer<NeighbourSegment> table(count, NeighbourSegment{});
  if (!table.allocated()) {
    return table;
  }
  std::size_t next = 0;
  visit_segments(geometry, reach_m, reach,
                 [&](const NeighbourSegment& segment) { table[next++] = segment; });
  // ... and in the middle of its segment this far from the other segment's next vertex.
  const auto distance2_m2 = [&](const NeighbourSegment& n) {
    const double cells = std::max(std::abs(n.ds) * kSegmentVertices - 0.5 * kSegmentVertices, 0.0);
    return std::pow(n.di * spacing_m.x(), 2) + std::pow(n.dj * spacing_m.y(), 2) +
           std::pow(cells * spacing_m.z(), 2);
  };
  std::sort(table.data(), table.data() + table.size(),
            [&](const NeighbourSegment& a, const NeighbourSegment& b) {
              const double a2 = distance2_m2(a);
              const double b2 = distance2_m2(b);
              // Equally distant ones in storage order, so that neighbours in memory follow each
              // other.
              return a2 != b2 ? a2 < b2 : std::tie(a.di, a.dj, a.ds) < std::tie(b.di, b.dj, b.ds);
            });
  return table;
}

}  // namespace forcegrid
