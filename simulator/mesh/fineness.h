// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace forcegrid::simulator {

/// How finely an object is made.
enum class Fineness : std::uint8_t {
  kAsWritten,
  /// About half the vertices per axis: (n + 1) / 2 of a block, a quarter of the vertices and edges
  /// of an organ, at least its fewest. An organ's home springs carry the same area with fewer
  /// vertices. Finite elements with edges twice as long, which Gmsh makes of their surface. Not for
  /// a mesh file of springs or of several regions.
  kHalf,
  /// Finite elements with edges one and a half times as long. For them alone.
  kTwoThirds
};

}  // namespace forcegrid::simulator
