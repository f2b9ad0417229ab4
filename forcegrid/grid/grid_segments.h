// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "forcegrid/grid/half.h"

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

/// The same in half the memory, for a device's own processor. A force keeps three digits, up to
/// 65 kN. A vertex stands still once its samples' weights are so large that another one would
/// change it by less than the last of 11 bits.
struct alignas(8) HalfVertex {
  std::array<Half, 3> force_W_N{};
  Half weight = Half::from_bits(0xbc00);  ///< -1: without data
};
static_assert(sizeof(HalfVertex) == 8);

struct alignas(64) HalfSegment {
  using Vertex = HalfVertex;
  std::array<HalfVertex, kSegmentVertices> vertices{};
};

inline ForceVertex unpacked(const ForceVertex& vertex) noexcept { return vertex; }
inline ForceVertex unpacked(const HalfVertex& vertex) noexcept {
  const float weight = vertex.weight.value();
  return {.force_W_N = {vertex.force_W_N[0].value(), vertex.force_W_N[1].value(),
                        vertex.force_W_N[2].value()},
          .weight = weight < 0.0F ? ForceVertex::kNoData : weight};
}
inline void pack(const ForceVertex& vertex, ForceVertex& stored) noexcept { stored = vertex; }
/// `vertex` has data. What is beyond the largest half is that.
inline void pack(const ForceVertex& vertex, HalfVertex& stored) noexcept {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    stored.force_W_N[axis] =
        Half(std::clamp(vertex.force_W_N[axis], -Half::kLargest, Half::kLargest));
  }
  stored.weight = Half(std::min(vertex.weight, Half::kLargest));
}

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
