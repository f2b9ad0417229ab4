// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/kernels/lanes.h"

namespace forcegrid::simulator::kernels {

/// Where a vertex lies in the coarse grid: its cell's lowest corner and its trilinear coordinates
/// there.
struct CoarsePlace {
  std::int32_t corner;
  float u, v, w;
};
/// A cell and its vertices, CoarseGrid::member[begin] to member[end - 1].
struct CoarseCell {
  std::int32_t corner, begin, end;
};
struct CoarseMember {
  std::int32_t vertex;
  float u, v, w;
};

/// Trilinear interpolation from a small regular grid over the object: the coarse half of the
/// preconditioner. An empty `place` switches it off.
struct CoarseGrid {
  std::int32_t node_count = 0;
  std::int32_t stride_y = 0;  ///< node number = x + stride_y y + stride_z z
  std::int32_t stride_z = 0;
  std::vector<CoarsePlace> place;  ///< one per vertex
  std::vector<CoarseCell> cell;    ///< the same, cell by cell
  std::vector<CoarseMember> member;
  std::vector<float> inverse_m_per_N;  ///< (3 node_count)^2, row major: the coarse K's inverse
};

/// The coarse half of take_step(): coarse_residual = P^T residual, nothing for an empty grid; the
/// residual is 0 on vertices that can't move freely.
void restrict_residual(const CoarseGrid& coarse, const Lanes* residual,
                       Lanes* coarse_residual) noexcept;

/// next_direction() where there is a coarse grid.
void next_direction_with(const CoarseGrid& coarse, Float4 beta, const BlockInverse* inverse,
                         const Lanes* coarse_correction, Lanes* direction, Lanes* product) noexcept;

/// coarse_correction = (P^T K P)^-1 coarse_residual.
/// @returns the lanes' dot products of the two.
Float4 solve_coarse(const CoarseGrid& coarse, const Lanes* coarse_residual,
                    Lanes* coarse_correction) noexcept;

}  // namespace forcegrid::simulator::kernels
