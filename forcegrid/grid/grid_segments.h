// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace forcegrid {

/// Grids are stored, filled and cleared in segments: eight vertices that follow each other along z,
/// the first of them at a multiple of eight. One SIMD step updates one segment.
inline constexpr int kSegmentVertices = 8;

/// A vertex of the paper's grid. The weight is the sum of its samples' weights, and far below zero
/// before the first of them, so that a blend of eight vertices shows whether one is without data.
struct alignas(16) ForceVertex {
  std::array<float, 3> force_W_N{};
  float weight = kNoData;

  static constexpr float kNoData = -1e30F;
};
static_assert(sizeof(ForceVertex) == 16);

struct alignas(64) ForceSegment {
  using Vertex = ForceVertex;
  std::array<ForceVertex, kSegmentVertices> vertices{};
};

/// Weighted sums of a vertex's samples, with u = (P - v) / r from the vertex to the sample:
/// 0: w; 1-3: w u; 4-9: w u_x^2, u_y^2, u_z^2, u_x u_y, u_x u_z, u_y u_z; 10-12: w F;
/// 13-21: w F_i u_j, row by row.
inline constexpr int kMoments = 22;

/// The moments of eight vertices, all of one kind side by side.
struct alignas(64) MomentSegment {
  std::array<std::array<float, kSegmentVertices>, kMoments> moments{};
};
static_assert(sizeof(MomentSegment) == 22 * 32);

}  // namespace forcegrid
