// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/spring_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "simulator/kernels/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

// Below this a diagonal block counts as singular; its entries carry single precision's 1e-7.
constexpr double kSmallestRelativeDeterminant = 1e-7;

FORCEGRID_INLINE Float4 rotate_left(Float4 v) { return __builtin_shufflevector(v, v, 1, 2, 0, 3); }

FORCEGRID_MULTIVERSION void add_precise_forces_to(const SpringRows& rows, const double* t_N_per_m,
                                                  const Precise* position,
                                                  Precise* force) noexcept {
  const std::int32_t vertices = rows.active;
  const std::int32_t* const row_begin = rows.row_begin.data();
  const std::int32_t* const other = rows.other.data();
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Double4 here = position[i].xyz;
    Double4 sum = force[i].xyz;
    for (std::int32_t s = row_begin[i]; s < row_begin[i + 1]; ++s) {
      const std::int32_t j = other[s];
      const double t = t_N_per_m[s];
      const Double4 f = (position[j].xyz - here) * Double4{t, t, t, t};
      sum += f;
      force[j].xyz -= f;
    }
    force[i].xyz = sum;
  }
}

FORCEGRID_MULTIVERSION void take_positions_of(std::int32_t vertex_count, const Lanes* state,
                                              Single* position) noexcept {
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    position[i].xyz =
        Float4{state[i].component[0][0], state[i].component[1][0], state[i].component[2][0], 0.0F};
  }
}

// Applies the springs of one row to the vertices at their ends, with the sign kSign of K. Adds to
// sum[] their effect on the row's own vertex, whose three components are `here`, and subtracts the
// same from there[] at their other ends. `scale` multiplies, in each lane, the part along a spring,
// w (w . d), but not t d.
template <int kSign>
FORCEGRID_INLINE void add_row(std::int32_t begin, std::int32_t end, const std::int32_t* other,
                              const SpringTangent* tangent, const Lanes* from, const Float4& scale,
                              const Float4 (&here)[3], Float4 (&sum)[3], Lanes* there) {
  for (std::int32_t s = begin; s < end; ++s) {
    const Lanes& ends = from[other[s]];
    Lanes& at = there[other[s]];
    const Float4 w[3] = {broadcast(tangent[s].w_x), broadcast(tangent[s].w_y),
                         broadcast(tangent[s].w_z)};
    const Float4 t = broadcast(tangent[s].t_N_per_m);
    Float4 d[3];
    for (int c = 0; c < 3; ++c) {
      d[c] = kSign > 0 ? here[c] - ends.component[c] : ends.component[c] - here[c];
    }
    const Float4 along = (w[0] * d[0] + w[1] * d[1] + w[2] * d[2]) * scale;
    for (int c = 0; c < 3; ++c) {
      const Float4 f = t * d[c] + w[c] * along;
      sum[c] += f;
      at.component[c] -= f;
    }
  }
}

// -(H d) added at each vertex; in lane 0 only t d, which is the spring's force.
FORCEGRID_MULTIVERSION void add_residuals_of(const SpringRows& rows, const SpringTangent* tangent,
                                             const Lanes* state, Lanes* residual) noexcept {
  const std::int32_t* const row_begin = rows.row_begin.data();
  const Float4 sensitivity_lanes{0.0F, 1.0F, 1.0F, 1.0F};
  for (std::int32_t i = 0; i < rows.active; ++i) {
    const Float4 x[3] = {state[i].component[0], state[i].component[1], state[i].component[2]};
    Float4 r[3] = {residual[i].component[0], residual[i].component[1], residual[i].component[2]};
    add_row<-1>(row_begin[i], row_begin[i + 1], rows.other.data(), tangent, state,
                sensitivity_lanes, x, r, residual);
    for (int c = 0; c < 3; ++c) {
      residual[i].component[c] = r[c];
    }
  }
}

FORCEGRID_MULTIVERSION void add_blocks_of(const SpringRows& rows, const SpringTangent* tangent,
                                          BlockInverse* block) noexcept {
  const std::int32_t vertices = rows.active;
  for (std::int32_t i = 0; i < vertices; ++i) {
    BlockInverse sum = block[i];
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const Float4 w{tangent[s].w_x, tangent[s].w_y, tangent[s].w_z, 0.0F};
      const float t = std::max(tangent[s].t_N_per_m, 0.0F);
      const Float4 diagonal = w * w + Float4{t, t, t, 0.0F};
      const Float4 off_diagonal = w * rotate_left(w);
      BlockInverse& there = block[rows.other[s]];
      sum.diagonal += diagonal;
      sum.off_diagonal += off_diagonal;
      there.diagonal += diagonal;
      there.off_diagonal += off_diagonal;
    }
    block[i] = sum;
  }
}

template <bool kHome>
FORCEGRID_INLINE void apply_rows(const SpringRows& rows, const SpringTangent* tangent,
                                 const float* home_N_per_m, const Lanes* direction, Lanes* product,
                                 Float4* dot) {
  const std::int32_t* const row_begin = rows.row_begin.data();
  const Float4 all_lanes = broadcast(1.0F);
  Float4 sum{};
  for (std::int32_t i = 0; i < rows.active; ++i) {
    const Float4 p[3] = {direction[i].component[0], direction[i].component[1],
                         direction[i].component[2]};
    Float4 q[3] = {product[i].component[0], product[i].component[1], product[i].component[2]};
    if constexpr (kHome) {
      for (int c = 0; c < 3; ++c) {
        q[c] += broadcast(home_N_per_m[i]) * p[c];
      }
    }
    add_row<1>(row_begin[i], row_begin[i + 1], rows.other.data(), tangent, direction, all_lanes, p,
               q, product);
    // Every spring of the lower vertices has been added by now, so row i of the product is final.
    for (int c = 0; c < 3; ++c) {
      product[i].component[c] = q[c];
      sum += p[c] * q[c];
    }
  }
  *dot = sum;
}

// Vectors are passed by address: their calling convention differs between the versions.
FORCEGRID_MULTIVERSION void apply_stiffness_to(const SpringRows& rows, const SpringTangent* tangent,
                                               const float* home_N_per_m, const Lanes* direction,
                                               Lanes* product, Float4* dot) noexcept {
  if (home_N_per_m != nullptr) {
    apply_rows<true>(rows, tangent, home_N_per_m, direction, product, dot);
  } else {
    apply_rows<false>(rows, tangent, nullptr, direction, product, dot);
  }
}

// z = M r.
FORCEGRID_INLINE void apply_inverse(const BlockInverse& m, const Float4 (&r)[3], Float4 (&z)[3]) {
  const Float4 xx = broadcast(m.diagonal[0]);
  const Float4 yy = broadcast(m.diagonal[1]);
  const Float4 zz = broadcast(m.diagonal[2]);
  const Float4 xy = broadcast(m.off_diagonal[0]);
  const Float4 yz = broadcast(m.off_diagonal[1]);
  const Float4 zx = broadcast(m.off_diagonal[2]);
  z[0] = xx * r[0] + xy * r[1] + zx * r[2];
  z[1] = xy * r[0] + yy * r[1] + yz * r[2];
  z[2] = zx * r[0] + yz * r[1] + zz * r[2];
}

FORCEGRID_MULTIVERSION void precondition_on(std::int32_t vertex_count, const BlockInverse* inverse,
                                            const Lanes* residual, Lanes* product,
                                            Float4* dot) noexcept {
  Float4 sum{};
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    const Float4 r[3] = {residual[i].component[0], residual[i].component[1],
                         residual[i].component[2]};
    Float4 z[3];
    apply_inverse(inverse[i], r, z);
    for (int c = 0; c < 3; ++c) {
      product[i].component[c] = z[c];
      sum += r[c] * z[c];
    }
  }
  *dot = sum;
}

FORCEGRID_MULTIVERSION void take_step_on(std::int32_t vertex_count, const Float4* alpha_lanes,
                                         const BlockInverse* inverse, const Lanes* direction,
                                         Lanes* state, Lanes* residual, Lanes* product,
                                         StepSums* sums) noexcept {
  const Float4 alpha = *alpha_lanes;
  Float4 preconditioned{};
  Float4 former{};
  Float4 squared{};
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    const BlockInverse& m = inverse[i];
    const Float4 free_alpha = alpha * broadcast(m.diagonal[3]);
    Float4 before[3];
    Float4 r[3];
    for (int c = 0; c < 3; ++c) {
      state[i].component[c] += alpha * direction[i].component[c];
      before[c] = residual[i].component[c];
      r[c] = before[c] - free_alpha * product[i].component[c];
      residual[i].component[c] = r[c];
    }
    Float4 z[3];
    apply_inverse(m, r, z);
    for (int c = 0; c < 3; ++c) {
      product[i].component[c] = z[c];
    }
    preconditioned += r[0] * z[0] + r[1] * z[1] + r[2] * z[2];
    former += before[0] * z[0] + before[1] * z[1] + before[2] * z[2];
    squared += r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
  }
  sums->preconditioned = preconditioned;
  sums->former = former;
  sums->squared = squared;
}

FORCEGRID_MULTIVERSION void next_direction_on(std::int32_t vertex_count, const Float4* beta,
                                              Lanes* direction, Lanes* product) noexcept {
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    for (int c = 0; c < 3; ++c) {
      direction[i].component[c] = product[i].component[c] + *beta * direction[i].component[c];
      product[i].component[c] = Float4{};
    }
  }
}

// Sums over this many vertices stay in single precision before they go into double.
constexpr std::int32_t kSinglePrecisionRun = 32;

FORCEGRID_MULTIVERSION void summarise_on(std::int32_t vertex_count, const BlockInverse* inverse,
                                         const Lanes* state, const Lanes* residual,
                                         const Precise* force, StateSums* sums) noexcept {
  Double4 row[3] = {};
  Double4 squared{};
  double precise_force[3] = {};
  double precise_squared = 0.0;
  for (std::int32_t begin = 0; begin < vertex_count; begin += kSinglePrecisionRun) {
    const std::int32_t end = std::min(begin + kSinglePrecisionRun, vertex_count);
    Float4 run[3] = {};
    Float4 squared_run{};
    for (std::int32_t i = begin; i < end; ++i) {
      const Float4 free = broadcast(inverse[i].diagonal[3]);
      for (int c = 0; c < 3; ++c) {
        const Float4 x = state[i].component[c];
        const Float4 r = residual[i].component[c];
        for (int j = 0; j < 3; ++j) {
          run[j] += broadcast(x[1 + j]) * r;
        }
        squared_run += free * r * r;
        if (force != nullptr) {
          const double f = force[i].xyz[c];
          for (int j = 0; j < 3; ++j) {
            precise_force[j] += static_cast<double>(x[1 + j]) * f;
          }
          precise_squared += static_cast<double>(free[0]) * f * f;
        }
      }
    }
    for (int j = 0; j < 3; ++j) {
      row[j] += __builtin_convertvector(run[j], Double4);
    }
    squared += __builtin_convertvector(squared_run, Double4);
  }
  for (int j = 0; j < 3; ++j) {
    sums->force_N[j] = force != nullptr ? precise_force[j] : row[j][0];
    for (int k = 0; k < 3; ++k) {
      sums->stiffness_N_per_m[j][k] = row[j][1 + k];
    }
    sums->sensitivity_squared[j] = squared[1 + j];
  }
  sums->residual_squared_N2 = force != nullptr ? precise_squared : squared[0];
}

FORCEGRID_MULTIVERSION void predict_on(std::int32_t vertex_count, const float* step_m, float trend,
                                       Lanes* state, Lanes* before) noexcept {
  const Float4 step{0.0F, step_m[0], step_m[1], step_m[2]};
  const float half = 0.5F * trend;
  const Float4 half_trend{0.0F, half, half, half};
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    for (int c = 0; c < 3; ++c) {
      const Float4 x = state[i].component[c];
      Float4 next = x + half_trend * (x - before[i].component[c]);
      const Float4 move = next * step;
      next[0] = x[0] + (move[1] + move[2] + move[3]);
      before[i].component[c] = x;
      state[i].component[c] = next;
    }
  }
}

}  // namespace

void evaluate(const SpringRows& rows, const SpringConstants<float>* constants, bool exponential,
              const Lanes* state, Single* position, Lanes* residual,
              SpringTangent* tangent) noexcept {
  take_positions(rows.reach, state, position);
  find_tangents(rows, constants, exponential, position, tangent);
  std::fill_n(residual, rows.reach, Lanes{});
  add_residuals(rows, tangent, state, residual);
}

void evaluate(const SpringRows& rows, const SpringConstants<double>* constants, bool exponential,
              const Lanes* state, const Precise* position, double* t_N_per_m, Precise* force,
              Lanes* residual, SpringTangent* tangent) noexcept {
  find_tangents(rows, constants, exponential, position, t_N_per_m, tangent);
  std::fill_n(force, rows.reach, Precise{});
  add_precise_forces(rows, t_N_per_m, position, force);
  std::fill_n(residual, rows.reach, Lanes{});
  add_residuals(rows, tangent, state, residual);
  const std::int32_t vertices = rows.active;
  for (std::int32_t i = 0; i < vertices; ++i) {
    for (int c = 0; c < 3; ++c) {
      residual[i].component[c][0] = static_cast<float>(force[i].xyz[c]);
    }
  }
}

void take_positions(std::int32_t vertex_count, const Lanes* state, Single* position) noexcept {
  take_positions_of(vertex_count, state, position);
}

void add_residuals(const SpringRows& rows, const SpringTangent* tangent, const Lanes* state,
                   Lanes* residual) noexcept {
  add_residuals_of(rows, tangent, state, residual);
}

void add_precise_forces(const SpringRows& rows, const double* t_N_per_m, const Precise* position,
                        Precise* force) noexcept {
  add_precise_forces_to(rows, t_N_per_m, position, force);
}

void add_blocks(const SpringRows& rows, const SpringTangent* tangent,
                BlockInverse* block) noexcept {
  add_blocks_of(rows, tangent, block);
}

void sum_blocks(const SpringRows& rows, const SpringTangent* tangent,
                BlockInverse* block) noexcept {
  std::fill_n(block, rows.reach, BlockInverse{});
  add_blocks(rows, tangent, block);
}

Float4 precondition(std::int32_t vertex_count, const BlockInverse* inverse, const Lanes* residual,
                    Lanes* product) noexcept {
  Float4 dot{};
  precondition_on(vertex_count, inverse, residual, product, &dot);
  return dot;
}

Float4 apply_stiffness(const SpringRows& rows, const SpringTangent* tangent,
                       const float* home_N_per_m, const Lanes* direction, Lanes* product) noexcept {
  Float4 dot{};
  apply_stiffness_to(rows, tangent, home_N_per_m, direction, product, &dot);
  return dot;
}

StepSums take_step(std::int32_t vertex_count, Float4 alpha, const BlockInverse* inverse,
                   const CoarseGrid& coarse, const Lanes* direction, Lanes* state, Lanes* residual,
                   Lanes* product, Lanes* coarse_residual) noexcept {
  StepSums sums;
  take_step_on(vertex_count, &alpha, inverse, direction, state, residual, product, &sums);
  restrict_residual(coarse, residual, coarse_residual);
  return sums;
}

void next_direction(std::int32_t vertex_count, Float4 beta, const BlockInverse* inverse,
                    const CoarseGrid& coarse, const Lanes* coarse_correction, Lanes* direction,
                    Lanes* product) noexcept {
  if (coarse.place.empty()) {
    next_direction_on(vertex_count, &beta, direction, product);
  } else {
    next_direction_with(coarse, beta, inverse, coarse_correction, direction, product);
  }
}

StateSums summarise(std::int32_t vertex_count, const BlockInverse* inverse, const Lanes* state,
                    const Lanes* residual, const Precise* force) noexcept {
  StateSums sums;
  summarise_on(vertex_count, inverse, state, residual, force, &sums);
  return sums;
}

void predict(std::int32_t vertex_count, const float step_m[3], float trend, Lanes* state,
             Lanes* before) noexcept {
  predict_on(vertex_count, step_m, trend, state, before);
}

void invert_block(BlockInverse& block, bool free) noexcept {
  const double xx = block.diagonal[0];
  const double yy = block.diagonal[1];
  const double zz = block.diagonal[2];
  const double xy = block.off_diagonal[0];
  const double yz = block.off_diagonal[1];
  const double zx = block.off_diagonal[2];
  const double minor_x = yy * zz - yz * yz;
  const double minor_y = yz * zx - xy * zz;
  const double minor_z = xy * yz - yy * zx;
  const double determinant = xx * minor_x + xy * minor_y + zx * minor_z;
  block = BlockInverse{};
  if (!free) {
    return;
  }
  block.diagonal[3] = 1.0F;
  const double scale = std::abs(xx) + std::abs(yy) + std::abs(zz);
  const bool definite = xx > 0.0 && xx * yy > xy * xy;  // elements' blocks need not be
  if (definite && determinant > kSmallestRelativeDeterminant * scale * scale * scale) {
    block.diagonal[0] = static_cast<float>(minor_x / determinant);
    block.diagonal[1] = static_cast<float>((xx * zz - zx * zx) / determinant);
    block.diagonal[2] = static_cast<float>((xx * yy - xy * xy) / determinant);
    block.off_diagonal[0] = static_cast<float>(minor_y / determinant);
    block.off_diagonal[1] = static_cast<float>((xy * zx - xx * yz) / determinant);
    block.off_diagonal[2] = static_cast<float>(minor_z / determinant);
  } else if (scale > 0.0) {
    // A vertex held in a plane or along a line only, or one that gives way: its scalar stiffness
    // still gives a direction.
    for (int axis = 0; axis < 3; ++axis) {
      block.diagonal[axis] = static_cast<float>(1.0 / scale);
    }
  }
}

}  // namespace forcegrid::simulator::kernels
