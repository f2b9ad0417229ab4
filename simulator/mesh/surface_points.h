// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A material point of the surface: a fixed weighted mean of one, two or three vertices. Unused
/// entries repeat the first vertex, with weight 0.
struct SurfacePoint {
  std::array<std::int32_t, 3> vertex{};
  std::array<double, 3> weight{};
};

/// The points at which a tool presses on a surface.
struct SurfacePoints {
  std::vector<SurfacePoint> point;
  /// Points on a triangle, its edges and corners included: of[begin[t]] .. of[begin[t + 1] - 1].
  std::vector<std::int32_t> begin;
  std::vector<std::int32_t> of;
};

/// Covers SpringMesh::triangles with points: all corners, and more points on edges and faces until
/// no two neighbours are farther apart than `spacing_m` > 0 at rest. A point that only fixed
/// vertices carry is left out.
SurfacePoints make_surface_points(const SpringMesh& mesh, double spacing_m);

}  // namespace forcegrid::simulator
