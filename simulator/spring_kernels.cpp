#include "simulator/spring_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "simulator/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

// Below it a diagonal block is taken as singular; its entries carry single precision's 1e-7.
constexpr double kSmallestRelativeDeterminant = 1e-7;

FORCEGRID_INLINE Float4 broadcast(float value) { return Float4{value, value, value, value}; }

FORCEGRID_INLINE Float4 rotate_left(Float4 v) { return __builtin_shufflevector(v, v, 1, 2, 0, 3); }

FORCEGRID_MULTIVERSION void find_precise_forces(const SpringRows& rows, const double* t_N_per_m,
                                                const Precise* position, Precise* force) noexcept {
  const std::int32_t vertices = rows.active;
  const std::int32_t* const row_begin = rows.row_begin.data();
  const std::int32_t* const other = rows.other.data();
  for (std::int32_t i = 0; i < rows.reach; ++i) {
    force[i] = Precise{};
  }
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

// -(H d) summed at each vertex; in lane 0 only t d, which is the spring's force.
FORCEGRID_MULTIVERSION void find_residuals(const SpringRows& rows, const SpringTangent* tangent,
                                           const Lanes* state, Lanes* residual) noexcept {
  const std::int32_t vertices = rows.active;
  const std::int32_t* const row_begin = rows.row_begin.data();
  const std::int32_t* const other = rows.other.data();
  const Float4 sensitivity_lanes{0.0F, 1.0F, 1.0F, 1.0F};
  for (std::int32_t i = 0; i < rows.reach; ++i) {
    residual[i] = Lanes{};
  }
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Float4 x0 = state[i].component[0];
    const Float4 x1 = state[i].component[1];
    const Float4 x2 = state[i].component[2];
    Float4 r0 = residual[i].component[0];
    Float4 r1 = residual[i].component[1];
    Float4 r2 = residual[i].component[2];
    for (std::int32_t s = row_begin[i]; s < row_begin[i + 1]; ++s) {
      const std::int32_t j = other[s];
      const Float4 d0 = state[j].component[0] - x0;
      const Float4 d1 = state[j].component[1] - x1;
      const Float4 d2 = state[j].component[2] - x2;
      const Float4 w0 = broadcast(tangent[s].w_x);
      const Float4 w1 = broadcast(tangent[s].w_y);
      const Float4 w2 = broadcast(tangent[s].w_z);
      const Float4 t = broadcast(tangent[s].t_N_per_m);
      const Float4 along = (w0 * d0 + w1 * d1 + w2 * d2) * sensitivity_lanes;
      const Float4 f0 = t * d0 + w0 * along;
      const Float4 f1 = t * d1 + w1 * along;
      const Float4 f2 = t * d2 + w2 * along;
      r0 += f0;
      r1 += f1;
      r2 += f2;
      residual[j].component[0] -= f0;
      residual[j].component[1] -= f1;
      residual[j].component[2] -= f2;
    }
    residual[i].component[0] = r0;
    residual[i].component[1] = r1;
    residual[i].component[2] = r2;
  }
}

FORCEGRID_MULTIVERSION void find_blocks(const SpringRows& rows, const SpringTangent* tangent,
                                        BlockInverse* block) noexcept {
  const std::int32_t vertices = rows.active;
  for (std::int32_t i = 0; i < rows.reach; ++i) {
    block[i] = BlockInverse{};
  }
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

// Vectors are handed over by address: their calling convention differs between the versions.
FORCEGRID_MULTIVERSION void apply_stiffness_to(const SpringRows& rows, const SpringTangent* tangent,
                                               const Lanes* direction, Lanes* product,
                                               Float4* dot) noexcept {
  const std::int32_t vertices = rows.active;
  const std::int32_t* const row_begin = rows.row_begin.data();
  const std::int32_t* const other = rows.other.data();
  Float4 sum{};
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Float4 p0 = direction[i].component[0];
    const Float4 p1 = direction[i].component[1];
    const Float4 p2 = direction[i].component[2];
    Float4 q0 = product[i].component[0];
    Float4 q1 = product[i].component[1];
    Float4 q2 = product[i].component[2];
    for (std::int32_t s = row_begin[i]; s < row_begin[i + 1]; ++s) {
      const std::int32_t j = other[s];
      const Float4 d0 = p0 - direction[j].component[0];
      const Float4 d1 = p1 - direction[j].component[1];
      const Float4 d2 = p2 - direction[j].component[2];
      const Float4 w0 = broadcast(tangent[s].w_x);
      const Float4 w1 = broadcast(tangent[s].w_y);
      const Float4 w2 = broadcast(tangent[s].w_z);
      const Float4 t = broadcast(tangent[s].t_N_per_m);
      const Float4 along = w0 * d0 + w1 * d1 + w2 * d2;
      const Float4 f0 = t * d0 + w0 * along;
      const Float4 f1 = t * d1 + w1 * along;
      const Float4 f2 = t * d2 + w2 * along;
      q0 += f0;
      q1 += f1;
      q2 += f2;
      product[j].component[0] -= f0;
      product[j].component[1] -= f1;
      product[j].component[2] -= f2;
    }
    product[i].component[0] = q0;
    product[i].component[1] = q1;
    product[i].component[2] = q2;
    // Every spring of the lower vertices has been added by now, so row i of the product is final.
    sum += p0 * q0 + p1 * q1 + p2 * q2;
  }
  *dot = sum;
}

struct CoarseCell {
  std::int32_t node[8];
  float weight[8];
};

FORCEGRID_INLINE CoarseCell coarse_cell(const CoarseGrid& coarse, const CoarsePlace& place) {
  const std::int32_t c = place.corner;
  const std::int32_t y = coarse.stride_y;
  const std::int32_t z = coarse.stride_z;
  const float u1 = place.u;
  const float u0 = 1.0F - u1;
  const float v1 = place.v;
  const float v0 = 1.0F - v1;
  const float w1 = place.w;
  const float w0 = 1.0F - w1;
  return {{c, c + 1, c + y, c + y + 1, c + z, c + z + 1, c + z + y, c + z + y + 1},
          {u0 * v0 * w0, u1 * v0 * w0, u0 * v1 * w0, u1 * v1 * w0, u0 * v0 * w1, u1 * v0 * w1,
           u0 * v1 * w1, u1 * v1 * w1}};
}

template <bool kCoarse>
FORCEGRID_INLINE void take_step_inline(std::int32_t vertex_count, Float4 alpha,
                                       const BlockInverse* inverse, const CoarseGrid& coarse,
                                       const Lanes* direction, Lanes* state, Lanes* residual,
                                       Lanes* product, Lanes* coarse_residual, StepSums* sums) {
  Float4 preconditioned{};
  Float4 squared{};
  if constexpr (kCoarse) {
    for (std::int32_t k = 0; k < coarse.node_count; ++k) {
      coarse_residual[k] = Lanes{};
    }
  }
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    const BlockInverse& m = inverse[i];
    const Float4 free_alpha = alpha * broadcast(m.diagonal[3]);
    Float4 r[3];
    for (int c = 0; c < 3; ++c) {
      state[i].component[c] += alpha * direction[i].component[c];
      r[c] = residual[i].component[c] - free_alpha * product[i].component[c];
      residual[i].component[c] = r[c];
    }
    const Float4 xx = broadcast(m.diagonal[0]);
    const Float4 yy = broadcast(m.diagonal[1]);
    const Float4 zz = broadcast(m.diagonal[2]);
    const Float4 xy = broadcast(m.off_diagonal[0]);
    const Float4 yz = broadcast(m.off_diagonal[1]);
    const Float4 zx = broadcast(m.off_diagonal[2]);
    const Float4 z0 = xx * r[0] + xy * r[1] + zx * r[2];
    const Float4 z1 = xy * r[0] + yy * r[1] + yz * r[2];
    const Float4 z2 = zx * r[0] + yz * r[1] + zz * r[2];
    product[i].component[0] = z0;
    product[i].component[1] = z1;
    product[i].component[2] = z2;
    preconditioned += r[0] * z0 + r[1] * z1 + r[2] * z2;
    squared += r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
    if constexpr (kCoarse) {
      const CoarseCell cell = coarse_cell(coarse, coarse.place[i]);
      for (int k = 0; k < 8; ++k) {
        const Float4 weight = broadcast(cell.weight[k]);
        Lanes& node = coarse_residual[cell.node[k]];
        node.component[0] += weight * r[0];
        node.component[1] += weight * r[1];
        node.component[2] += weight * r[2];
      }
    }
  }
  sums->preconditioned = preconditioned;
  sums->squared = squared;
}

FORCEGRID_MULTIVERSION void take_step_on(std::int32_t vertex_count, const Float4* alpha,
                                         const BlockInverse* inverse, const CoarseGrid& coarse,
                                         const Lanes* direction, Lanes* state, Lanes* residual,
                                         Lanes* product, Lanes* coarse_residual,
                                         StepSums* sums) noexcept {
  if (coarse.place.empty()) {
    take_step_inline<false>(vertex_count, *alpha, inverse, coarse, direction, state, residual,
                            product, coarse_residual, sums);
  } else {
    take_step_inline<true>(vertex_count, *alpha, inverse, coarse, direction, state, residual,
                           product, coarse_residual, sums);
  }
}

FORCEGRID_MULTIVERSION void solve_coarse_on(const CoarseGrid& coarse, const Lanes* coarse_residual,
                                            Lanes* coarse_correction, Float4* dot) noexcept {
  const std::int32_t nodes = coarse.node_count;
  const std::int32_t unknowns = 3 * nodes;
  Float4 sum{};
  for (std::int32_t k = 0; k < nodes; ++k) {
    const float* const row =
        &coarse
             .inverse_m_per_N[static_cast<std::size_t>(3 * k) * static_cast<std::size_t>(unknowns)];
    Float4 e[3] = {};
    for (std::int32_t m = 0; m < nodes; ++m) {
      for (int c = 0; c < 3; ++c) {
        const Float4 r = coarse_residual[m].component[c];
        for (int d = 0; d < 3; ++d) {
          e[d] += broadcast(row[d * unknowns + 3 * m + c]) * r;
        }
      }
    }
    for (int d = 0; d < 3; ++d) {
      coarse_correction[k].component[d] = e[d];
      sum += e[d] * coarse_residual[k].component[d];
    }
  }
  *dot = sum;
}

FORCEGRID_MULTIVERSION void next_direction_on(std::int32_t vertex_count, const Float4* beta_lanes,
                                              const BlockInverse* inverse, const CoarseGrid& coarse,
                                              const Lanes* coarse_correction, Lanes* direction,
                                              Lanes* product) noexcept {
  const Float4 beta = *beta_lanes;
  if (coarse.place.empty()) {
    for (std::int32_t i = 0; i < vertex_count; ++i) {
      for (int c = 0; c < 3; ++c) {
        direction[i].component[c] = product[i].component[c] + beta * direction[i].component[c];
        product[i].component[c] = Float4{};
      }
    }
    return;
  }
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    const CoarseCell cell = coarse_cell(coarse, coarse.place[i]);
    Float4 e[3] = {};
    for (int k = 0; k < 8; ++k) {
      const Float4 weight = broadcast(cell.weight[k]);
      const Lanes& node = coarse_correction[cell.node[k]];
      e[0] += weight * node.component[0];
      e[1] += weight * node.component[1];
      e[2] += weight * node.component[2];
    }
    const Float4 free = broadcast(inverse[i].diagonal[3]);
    for (int c = 0; c < 3; ++c) {
      direction[i].component[c] =
          product[i].component[c] + free * e[c] + beta * direction[i].component[c];
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
  const Float4 sensitivity_trend{0.0F, trend, trend, trend};
  for (std::int32_t i = 0; i < vertex_count; ++i) {
    for (int c = 0; c < 3; ++c) {
      const Float4 x = state[i].component[c];
      const Float4 change = sensitivity_trend * (x - before[i].component[c]);
      const Float4 move = (x + 0.5F * change) * step;
      Float4 next = x + change;
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
  find_tangents(rows, constants, exponential, state, position, tangent);
  find_residuals(rows, tangent, state, residual);
}

void evaluate(const SpringRows& rows, const SpringConstants<double>* constants, bool exponential,
              const Lanes* state, const Precise* position, double* t_N_per_m, Precise* force,
              Lanes* residual, SpringTangent* tangent) noexcept {
  find_tangents(rows, constants, exponential, position, t_N_per_m, tangent);
  find_precise_forces(rows, t_N_per_m, position, force);
  find_residuals(rows, tangent, state, residual);
  const std::int32_t vertices = rows.active;
  for (std::int32_t i = 0; i < vertices; ++i) {
    for (int c = 0; c < 3; ++c) {
      residual[i].component[c][0] = static_cast<float>(force[i].xyz[c]);
    }
  }
}

void sum_blocks(const SpringRows& rows, const SpringTangent* tangent,
                BlockInverse* block) noexcept {
  find_blocks(rows, tangent, block);
}

Float4 apply_stiffness(const SpringRows& rows, const SpringTangent* tangent, const Lanes* direction,
                       Lanes* product) noexcept {
  Float4 dot{};
  apply_stiffness_to(rows, tangent, direction, product, &dot);
  return dot;
}

StepSums take_step(std::int32_t vertex_count, Float4 alpha, const BlockInverse* inverse,
                   const CoarseGrid& coarse, const Lanes* direction, Lanes* state, Lanes* residual,
                   Lanes* product, Lanes* coarse_residual) noexcept {
  StepSums sums;
  take_step_on(vertex_count, &alpha, inverse, coarse, direction, state, residual, product,
               coarse_residual, &sums);
  return sums;
}

Float4 solve_coarse(const CoarseGrid& coarse, const Lanes* coarse_residual,
                    Lanes* coarse_correction) noexcept {
  Float4 dot{};
  if (!coarse.place.empty()) {
    solve_coarse_on(coarse, coarse_residual, coarse_correction, &dot);
  }
  return dot;
}

void next_direction(std::int32_t vertex_count, Float4 beta, const BlockInverse* inverse,
                    const CoarseGrid& coarse, const Lanes* coarse_correction, Lanes* direction,
                    Lanes* product) noexcept {
  next_direction_on(vertex_count, &beta, inverse, coarse, coarse_correction, direction, product);
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
  const double scale = xx + yy + zz;
  if (determinant > kSmallestRelativeDeterminant * scale * scale * scale) {
    block.diagonal[0] = static_cast<float>(minor_x / determinant);
    block.diagonal[1] = static_cast<float>((xx * zz - zx * zx) / determinant);
    block.diagonal[2] = static_cast<float>((xx * yy - xy * xy) / determinant);
    block.off_diagonal[0] = static_cast<float>(minor_y / determinant);
    block.off_diagonal[1] = static_cast<float>((xy * zx - xx * yz) / determinant);
    block.off_diagonal[2] = static_cast<float>(minor_z / determinant);
  } else if (scale > 0.0) {
    // A vertex held in a plane or along a line only: its scalar stiffness still gives a direction.
    for (int axis = 0; axis < 3; ++axis) {
      block.diagonal[axis] = static_cast<float>(1.0 / scale);
    }
  }
}

}  // namespace forcegrid::simulator::kernels
