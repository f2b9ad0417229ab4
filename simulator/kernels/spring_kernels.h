// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "simulator/kernels/coarse_kernels.h"
#include "simulator/kernels/lanes.h"
#include "simulator/kernels/spring_laws.h"

namespace forcegrid::simulator::kernels {

/// Forces and sensitivity residuals of the current state.
///   residual lane 0:  r = -dE/dx (springs' force on each vertex) [N]
///   residual lane j:  -(K S)_j [N/m]
/// with S from lanes 1-3 of `state`. Positions come from lane 0 of `state` in single precision
/// (`position` is scratch), or from `position` in double; then r is in `force` in full precision as
/// well, lane 0 of `state` is ignored and `t_N_per_m` is scratch.
/// @param exponential  whether any spring has an exponent; false saves the time.
void evaluate(const SpringRows& rows, const SpringConstants<float>* constants, bool exponential,
              const Lanes* state, Single* position, Lanes* residual,
              SpringTangent* tangent) noexcept;
void evaluate(const SpringRows& rows, const SpringConstants<double>* constants, bool exponential,
              const Lanes* state, const Precise* position, double* t_N_per_m, Precise* force,
              Lanes* residual, SpringTangent* tangent) noexcept;

/// The parts of evaluate(). take_positions() copies lane 0 of the first `vertex_count` states;
/// add_residuals() adds what the springs' tangents give to `residual`, -t d in lane 0 included;
/// add_precise_forces() adds the springs' forces in double.
void take_positions(std::int32_t vertex_count, const Lanes* state, Single* position) noexcept;
void add_residuals(const SpringRows& rows, const SpringTangent* tangent, const Lanes* state,
                   Lanes* residual) noexcept;
void add_precise_forces(const SpringRows& rows, const double* t_N_per_m, const Precise* position,
                        Precise* force) noexcept;

/// block += sum of w w^T + max(t, 0) I over each vertex's springs, to be inverted by
/// invert_block(). The clamp keeps the preconditioner positive; K itself is not clamped.
void add_blocks(const SpringRows& rows, const SpringTangent* tangent, BlockInverse* block) noexcept;

/// The same from zero.
void sum_blocks(const SpringRows& rows, const SpringTangent* tangent, BlockInverse* block) noexcept;

/// product = K direction; `product` must be zero before.
/// @param home_N_per_m  each vertex's home spring, see VertexForce; null: there are none.
/// @returns the lanes' dot products direction . product.
Float4 apply_stiffness(const SpringRows& rows, const SpringTangent* tangent,
                       const float* home_N_per_m, const Lanes* direction, Lanes* product) noexcept;

/// product = M residual, M the block-Jacobi part: how a correction begins.
/// @returns the lanes' dot products residual . product.
Float4 precondition(std::int32_t vertex_count, const BlockInverse* inverse, const Lanes* residual,
                    Lanes* product) noexcept;

/// state += alpha direction; residual -= alpha product on free vertices; product = M residual, M
/// the block-Jacobi part; coarse_residual = P^T residual.
struct StepSums {
  Float4 preconditioned;  ///< residual . M residual
  Float4 former;          ///< the residual before the step . M residual
  Float4 squared;         ///< residual . residual over the free vertices
};
StepSums take_step(std::int32_t vertex_count, Float4 alpha, const BlockInverse* inverse,
                   const CoarseGrid& coarse, const Lanes* direction, Lanes* state, Lanes* residual,
                   Lanes* product, Lanes* coarse_residual) noexcept;

/// direction = product + P coarse_correction + beta direction; product = 0.
void next_direction(std::int32_t vertex_count, Float4 beta, const BlockInverse* inverse,
                    const CoarseGrid& coarse, const Lanes* coarse_correction, Lanes* direction,
                    Lanes* product) noexcept;

/// Sums over a state, see ElasticObject: with R the residual's lanes,
///   force = sum_i S_i^T r_i (over all vertices: the patch has S = I, fixed ones S = 0)
///   stiffness = sum_i S_i^T (-K S)_i.
struct StateSums {
  double force_N[3];
  double stiffness_N_per_m[3][3];
  double residual_squared_N2;     ///< over the free vertices
  double sensitivity_squared[3];  ///< [N^2/m^2] |(K S)_j|^2 over the free vertices
};
/// @param force  null, or the forces in double precision, used instead of lane 0 of `residual`.
StateSums summarise(std::int32_t vertex_count, const BlockInverse* inverse, const Lanes* state,
                    const Lanes* residual, const Precise* force) noexcept;

/// Moves `state` to where the tool will be, to second order along the tool's last step:
///   x += (S + trend/2 (S - S_before)) step,   S += trend/2 (S - S_before),   before = old state
/// S follows half of its trend. An error that nothing corrects is multiplied from step to step by
/// the roots of (z - 1)(z - trend/2): for |trend| < 2 it stays bounded. With the whole trend it
/// would grow with every step and cause corrections that a steady S avoids.
/// @param trend  the step's component along the last one over the length of the last one; 0 for
///   the first-order x += S step alone.
void predict(std::int32_t vertex_count, const float step_m[3], float trend, Lanes* state,
             Lanes* before) noexcept;

/// Turns the sums that evaluate() gave into the block's inverse.
void invert_block(BlockInverse& block, bool free) noexcept;

}  // namespace forcegrid::simulator::kernels
