// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "view_link/inside_messages.h"

/// The parts of a mesh that the live view draws, with vertices of their own numbering.
/// Real-time: no. Threads: any.
namespace forcegrid::simulator {

/// The vertices that a triangle has.
struct DrawnSurface {
  std::vector<std::int32_t> vertices;                   ///< the mesh's number of each, ascending
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< of SpringMesh::triangles, same order
};
DrawnSurface drawn_surface(const SpringMesh& mesh);

/// The springs that are not severed, in the mesh's order, then each edge of the elements once.
/// Those of an object that has more than view_link::kMostEdges are counted alone.
struct DrawnInside {
  std::vector<std::int32_t> vertices;  ///< the mesh's number of each that an edge has, ascending
  view_link::InsideLines lines;        ///< epoch 0
};
DrawnInside drawn_inside(const SpringMesh& mesh);

}  // namespace forcegrid::simulator
