// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "simulator/kernels/element_kernels.h"
#include "simulator/kernels/spring_kernels.h"

// The loops of DynamicObject. As with the other kernels, all arrays have one entry per vertex or
// per spring in the order of SpringRows, and component 3 of every vector is 0.
namespace forcegrid::simulator::kernels {

/// What one spring adds to a step's matrix: Q = q q^T + b I between its two ends, with
///   q q^T = (h^2 (f' - max(f/l, 0)) + h c) u u^T,   b = h^2 max(f/l, 0)   [kg]
/// for a step h and a damper c: f' along the spring, and across it what tension resists with, not
/// what compression gives way with. The matrix is definite whatever the springs' state.
struct alignas(32) StepSpring {
  Double4 q_and_b;
};

/// @param tangent,t_N_per_m  of find_tangents() at the step's beginning.
void make_step_springs(std::size_t count, const SpringTangent* tangent, const double* t_N_per_m,
                       const double* damper_Ns_per_m, double step_s, StepSpring* step) noexcept;

/// force += the springs' pull on both ends: (f/l) d.
void add_spring_forces(const SpringRows& rows, const double* t_N_per_m, const Precise* position,
                       Precise* force) noexcept;

/// force += the dampers' pull on both ends: c (u . (v_b - v_a)) u.
void add_damper_forces(const SpringRows& rows, const SpringTangent* tangent,
                       const double* damper_Ns_per_m, const Precise* velocity,
                       Precise* force) noexcept;

/// product = (diag(inertia) + sum of Q) direction.
void apply_step_matrix(const SpringRows& rows, const StepSpring* step, const double* inertia_kg,
                       const Precise* direction, Precise* product) noexcept;

/// A symmetric 3 x 3 matrix: its diagonal, and xy, yz, zx.
struct alignas(32) SymmetricBlock {
  Double4 diagonal;
  Double4 off_diagonal;
};

/// The matrix's diagonal blocks.
void sum_step_blocks(const SpringRows& rows, const StepSpring* step, const double* inertia_kg,
                     SymmetricBlock* block) noexcept;

/// Their inverses, in their place; all zero for a vertex that is not free.
void invert_step_blocks(std::size_t count, const std::uint8_t* free,
                        SymmetricBlock* block) noexcept;

/// product += scale K direction, K of elements' edges, see ForceModel; `scale` is that of an edge's
/// lower vertex.
void add_edge_products(const SpringRows& rows, const EdgeStiffness* edge, const double* scale,
                       const Precise* direction, Precise* product) noexcept;

/// block += scale K's diagonal blocks.
void add_edge_step_blocks(const SpringRows& rows, const EdgeStiffness* edge, const double* scale,
                          SymmetricBlock* block) noexcept;

/// Sums of one step of conjugate gradients.
struct DescentSums {
  double squared = 0.0;         ///< residual . residual
  double preconditioned = 0.0;  ///< residual . M residual
};

/// solution += alpha direction; residual -= alpha product, zero where not free;
/// product = M residual.
DescentSums descend(std::size_t count, double alpha, const std::uint8_t* free,
                    const SymmetricBlock* inverse, const Precise* direction, Precise* solution,
                    Precise* residual, Precise* product) noexcept;

/// direction = product + beta direction.
void turn_direction(std::size_t count, double beta, const Precise* product,
                    Precise* direction) noexcept;

double dot(std::size_t count, const Precise* a, const Precise* b) noexcept;

}  // namespace forcegrid::simulator::kernels
