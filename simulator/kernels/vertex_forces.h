// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "simulator/kernels/lanes.h"

namespace forcegrid::simulator::kernels {

/// Forces on a vertex beside the springs to others: a home spring to its rest position, and a dead
/// load of constant direction and size.
struct VertexForce {
  double rest_m[3];
  double load_N[3];
  float home_stiffness_N_per_m;
};

/// Adds r += load - k_home (x - X) and, to lanes 1 to 3, -k_home S: to what evaluate() gave for the
/// same state.
void add_vertex_forces(std::span<const VertexForce> forces, const Lanes* state,
                       Lanes* residual) noexcept;
void add_vertex_forces(std::span<const VertexForce> forces, const Lanes* state,
                       const Precise* position, Precise* force, Lanes* residual) noexcept;

/// Adds the home springs to the blocks that sum_blocks() gave.
void add_home_blocks(std::span<const VertexForce> forces, BlockInverse* block) noexcept;

/// Their home springs alone, for apply_stiffness().
std::vector<float> home_stiffness_N_per_m(std::span<const VertexForce> forces);

}  // namespace forcegrid::simulator::kernels
