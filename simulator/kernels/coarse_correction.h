// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "simulator/kernels/element_kernels.h"
#include "simulator/kernels/spring_kernels.h"
#include "simulator/kernels/vertex_forces.h"

namespace forcegrid::simulator {

/// The coarse half of the solver's preconditioner: M = block-Jacobi + P (P^T K P)^-1 P^T, with P
/// the trilinear interpolation from a regular grid of a few dozen cells (some hundred for objects
/// of 100,000 vertices) over the object's rest shape, 0 on vertices that can't move freely.
/// Block-Jacobi alone carries a change one spring per iteration; the coarse half carries it across
/// the object at once, which matters when a force that was large has to be small to the same
/// relative tolerance. Source: additive two-level preconditioning, Smith, Bjorstad and Gropp,
/// Domain Decomposition (1996), section 2.1.
/// @param rest  [m] the vertices' rest positions.
/// @returns the places alone; an empty grid for an object too small to gain from it.
kernels::CoarseGrid make_coarse_grid(const std::vector<Eigen::Vector3d>& rest);

/// P^T K P before anything is in it, for a grid that is not empty.
Eigen::MatrixXf begin_coarse(const kernels::CoarseGrid& coarse);

/// Adds the springs' part to the lower triangle.
void add_coarse_stiffness(const kernels::SpringRows& rows,
                          const std::vector<kernels::SpringTangent>& tangent,
                          const std::vector<std::uint8_t>& free, const kernels::CoarseGrid& coarse,
                          Eigen::MatrixXf& stiffness);

/// The same of elements' edges.
void add_coarse_stiffness(const kernels::SpringRows& rows,
                          const std::vector<kernels::EdgeStiffness>& edge,
                          const std::vector<std::uint8_t>& free, const kernels::CoarseGrid& coarse,
                          Eigen::MatrixXf& stiffness);

/// Adds the home springs and inverts. Uses up `stiffness`.
void finish_coarse(Eigen::MatrixXf& stiffness,
                   const std::vector<kernels::VertexForce>& vertex_force,
                   const std::vector<std::uint8_t>& free, kernels::CoarseGrid& coarse);

/// Fills in the inverse of P^T K P for the springs' present tangents and the home springs.
/// @param free  1 for a vertex that moves freely.
void invert_coarse(const kernels::SpringRows& rows,
                   const std::vector<kernels::SpringTangent>& tangent,
                   const std::vector<kernels::VertexForce>& vertex_force,
                   const std::vector<std::uint8_t>& free, kernels::CoarseGrid& coarse);

}  // namespace forcegrid::simulator
