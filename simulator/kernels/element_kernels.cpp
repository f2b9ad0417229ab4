// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/element_kernels.h"

#include <algorithm>
#include <cmath>

#include "simulator/kernels/element_laws.h"
#include "simulator/kernels/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

// What a group of elements does to its vertices and edges, number by number.
template <typename Real>
struct alignas(kElementRegister) ElementEffects {
  Real force_N[4][3][kElementsSideBySide<Real>];
  float edge_N_per_m[6][3][3][kElementsSideBySide<Real>];  // row, column
};

template <typename Real, typename Place>
FORCEGRID_INLINE void gather_edges(const ElementCorners* corners, std::size_t count,
                                   const Place* position, Matrix<Real>& edges) {
  constexpr std::size_t kWidth = kElementsSideBySide<Real>;
  for (std::size_t lane = 0; lane < kWidth; ++lane) {
    const ElementCorners& element = corners[std::min(lane, count - 1)];
    const auto first = position[element.vertex[0]].xyz;
    for (int k = 0; k < 3; ++k) {
      const auto d = position[element.vertex[static_cast<std::size_t>(k) + 1]].xyz - first;
      for (int c = 0; c < 3; ++c) {
        edges.at[c][k][lane] = d[c];
      }
    }
  }
}

template <typename Real>
FORCEGRID_INLINE void load_constants(const ElementConstants<Real>& constants,
                                     ElementState<Real>& element) {
  using Vector = typename ElementState<Real>::Vector;
  for (int c = 0; c < 3; ++c) {
    element.gradient[0][c] = Vector{};
    for (int a = 0; a < 3; ++a) {
      element.gradient[a + 1][c] = load<Vector>(constants.gradient_per_m[a][c]);
      element.gradient[0][c] -= element.gradient[a + 1][c];
    }
    element.stiffness[c] = load<Vector>(constants.stiffness[c]);
  }
  element.volume = load<Vector>(constants.volume_m3);
}

template <ElementModel kModel, typename Real>
FORCEGRID_INLINE void find_effects(const ElementConstants<Real>& constants,
                                   const Matrix<Real>& edges, ElementEffects<Real>& effects) {
  using Vector = typename ElementState<Real>::Vector;
  ElementState<Real> element;
  load_constants(constants, element);
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < 3; ++d) {
      element.f.at[c][d] = edges.at[c][0] * element.gradient[1][d] +
                           edges.at[c][1] * element.gradient[2][d] +
                           edges.at[c][2] * element.gradient[3][d];
    }
  }
  ElementLaw<kModel, Real> law;
  law.find(element);
  Vector first[3] = {};
  for (int a = 1; a < 4; ++a) {
    for (int c = 0; c < 3; ++c) {
      const Vector force = -element.volume * (law.stress.at[c][0] * element.gradient[a][0] +
                                              law.stress.at[c][1] * element.gradient[a][1] +
                                              law.stress.at[c][2] * element.gradient[a][2]);
      store(effects.force_N[a][c], force);
      first[c] -= force;
    }
  }
  for (int c = 0; c < 3; ++c) {
    store(effects.force_N[0][c], first[c]);
  }
  for (std::size_t e = 0; e < kElementEdges.size(); ++e) {
    Matrix<Real> block;
    law.block(element, kElementEdges[e][0], kElementEdges[e][1], block);
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        const Vector h = -element.volume * block.at[c][d];
        if constexpr (sizeof(Real) == sizeof(float)) {
          store(effects.edge_N_per_m[e][c][d], h);
        } else {
          const Float4 narrow = __builtin_convertvector(h, Float4);
          store(effects.edge_N_per_m[e][c][d], narrow);
        }
      }
    }
  }
}

// Adds row c of each of four elements' blocks, which lie number by number in from[0..2].
FORCEGRID_INLINE void add_four_rows(const float* x, const float* y, const float* z,
                                    Float4* const (&row)[4]) {
  const Float4 xs = load<Float4>(x);
  const Float4 ys = load<Float4>(y);
  const Float4 zs = load<Float4>(z);
  const Float4 zero{};
  const Float4 xy_low = __builtin_shufflevector(xs, ys, 0, 4, 1, 5);
  const Float4 xy_high = __builtin_shufflevector(xs, ys, 2, 6, 3, 7);
  const Float4 z_low = __builtin_shufflevector(zs, zero, 0, 4, 1, 5);
  const Float4 z_high = __builtin_shufflevector(zs, zero, 2, 6, 3, 7);
  *row[0] += __builtin_shufflevector(xy_low, z_low, 0, 1, 4, 5);
  *row[1] += __builtin_shufflevector(xy_low, z_low, 2, 3, 6, 7);
  *row[2] += __builtin_shufflevector(xy_high, z_high, 0, 1, 4, 5);
  *row[3] += __builtin_shufflevector(xy_high, z_high, 2, 3, 6, 7);
}

template <typename Real>
FORCEGRID_INLINE void scatter(const ElementCorners* corners, std::size_t count,
                              const ElementEffects<Real>& effects, Precise* force, Lanes* residual,
                              EdgeStiffness* edge) {
  for (std::size_t lane = 0; lane < count; ++lane) {
    for (std::size_t a = 0; a < 4; ++a) {
      const std::int32_t i = corners[lane].vertex[a];
      if constexpr (sizeof(Real) == sizeof(float)) {
        for (int c = 0; c < 3; ++c) {
          residual[i].component[c][0] += effects.force_N[a][c][lane];
        }
      } else {
        force[i].xyz += Double4{effects.force_N[a][0][lane], effects.force_N[a][1][lane],
                                effects.force_N[a][2][lane], 0.0};
      }
    }
  }
  EdgeStiffness spare{};  // for the lanes that no element fills
  for (std::size_t four = 0; four < count; four += 4) {
    for (std::size_t e = 0; e < kElementEdges.size(); ++e) {
      for (int c = 0; c < 3; ++c) {
        Float4* row[4];
        for (std::size_t k = 0; k < 4; ++k) {
          row[k] = four + k < count ? &edge[corners[four + k].edge[e]].row[c] : &spare.row[c];
        }
        add_four_rows(&effects.edge_N_per_m[e][c][0][four], &effects.edge_N_per_m[e][c][1][four],
                      &effects.edge_N_per_m[e][c][2][four], row);
      }
    }
  }
}

template <ElementModel kModel, typename Real, typename Place>
FORCEGRID_INLINE void add_group(const ElementBatch<Real>& batch, std::size_t at, std::size_t count,
                                const Place* position, Precise* force, Lanes* residual,
                                EdgeStiffness* edge) {
  Matrix<Real> edges{};
  ElementEffects<Real> effects;
  const ElementCorners* const corners = &batch.corners[at];
  gather_edges(corners, count, position, edges);
  find_effects<kModel>(batch.constants[at / kElementsSideBySide<Real>], edges, effects);
  scatter(corners, count, effects, force, residual, edge);
}

template <ElementModel kModel, typename Real, typename Place>
FORCEGRID_INLINE void add_all(const ElementBatch<Real>& batch, std::size_t count,
                              const Place* position, Precise* force, Lanes* residual,
                              EdgeStiffness* edge) {
  for (std::size_t at = 0; at < count; at += kElementsSideBySide<Real>) {
    add_group<kModel>(batch, at, std::min(kElementsSideBySide<Real>, count - at), position, force,
                      residual, edge);
  }
}

// One function per energy and precision, so that each has a version for every processor.
#define FORCEGRID_ADD_ELEMENTS(name, model, Real, Place)                                   \
  FORCEGRID_MULTIVERSION void name(const ElementBatch<Real>& batch, std::size_t count,     \
                                   const Place* position, Precise* force, Lanes* residual, \
                                   EdgeStiffness* edge) noexcept {                         \
    add_all<model>(batch, count, position, force, residual, edge);                         \
  }
FORCEGRID_ADD_ELEMENTS(add_corotated, ElementModel::kCorotated, float, Single)
FORCEGRID_ADD_ELEMENTS(add_stvk, ElementModel::kStVenantKirchhoff, float, Single)
FORCEGRID_ADD_ELEMENTS(add_neo_hookean, ElementModel::kNeoHookean, float, Single)
FORCEGRID_ADD_ELEMENTS(add_precise_corotated, ElementModel::kCorotated, double, Precise)
FORCEGRID_ADD_ELEMENTS(add_precise_stvk, ElementModel::kStVenantKirchhoff, double, Precise)
FORCEGRID_ADD_ELEMENTS(add_precise_neo_hookean, ElementModel::kNeoHookean, double, Precise)
#undef FORCEGRID_ADD_ELEMENTS

// sum += H d at the row's own vertex, there -= H^T d at the other ends: for the sign 1 of K with d
// in all lanes; for -1 of -K, where `lanes` has a 1.
template <int kSign>
FORCEGRID_INLINE void add_edge_row(std::int32_t begin, std::int32_t end, const std::int32_t* other,
                                   const EdgeStiffness* edge, const Lanes* from,
                                   const Float4& lanes, const Float4 (&here)[3], Float4 (&sum)[3],
                                   Lanes* there) {
  for (std::int32_t s = begin; s < end; ++s) {
    const Lanes& ends = from[other[s]];
    Lanes& at = there[other[s]];
    const EdgeStiffness& h = edge[s];
    Float4 d[3];
    for (int c = 0; c < 3; ++c) {
      if constexpr (kSign > 0) {
        d[c] = here[c] - ends.component[c];
      } else {
        d[c] = (ends.component[c] - here[c]) * lanes;
      }
    }
    for (int c = 0; c < 3; ++c) {
      sum[c] += broadcast(h.row[c][0]) * d[0] + broadcast(h.row[c][1]) * d[1] +
                broadcast(h.row[c][2]) * d[2];
      at.component[c] -= broadcast(h.row[0][c]) * d[0] + broadcast(h.row[1][c]) * d[1] +
                         broadcast(h.row[2][c]) * d[2];
    }
  }
}

FORCEGRID_MULTIVERSION void add_edge_residuals_of(const SpringRows& rows, const EdgeStiffness* edge,
                                                  const Lanes* state, Lanes* residual) noexcept {
  const Float4 sensitivity_lanes{0.0F, 1.0F, 1.0F, 1.0F};
  for (std::int32_t i = 0; i < rows.active; ++i) {
    const Float4 x[3] = {state[i].component[0], state[i].component[1], state[i].component[2]};
    Float4 r[3] = {residual[i].component[0], residual[i].component[1], residual[i].component[2]};
    add_edge_row<-1>(rows.row_begin[static_cast<std::size_t>(i)],
                     rows.row_begin[static_cast<std::size_t>(i) + 1], rows.other.data(), edge,
                     state, sensitivity_lanes, x, r, residual);
    for (int c = 0; c < 3; ++c) {
      residual[i].component[c] = r[c];
    }
  }
}

FORCEGRID_MULTIVERSION void add_edge_blocks_of(const SpringRows& rows, const EdgeStiffness* edge,
                                               BlockInverse* block) noexcept {
  for (std::int32_t i = 0; i < rows.active; ++i) {
    BlockInverse sum = block[i];
    for (std::int32_t s = rows.row_begin[static_cast<std::size_t>(i)];
         s < rows.row_begin[static_cast<std::size_t>(i) + 1]; ++s) {
      const EdgeStiffness& h = edge[s];
      const Float4 diagonal{h.row[0][0], h.row[1][1], h.row[2][2], 0.0F};
      BlockInverse& there = block[rows.other[static_cast<std::size_t>(s)]];
      sum.diagonal += diagonal;
      sum.off_diagonal += Float4{h.row[0][1], h.row[1][2], h.row[2][0], 0.0F};
      there.diagonal += diagonal;
      there.off_diagonal += Float4{h.row[1][0], h.row[2][1], h.row[0][2], 0.0F};
    }
    block[i] = sum;
  }
}

FORCEGRID_MULTIVERSION void apply_edges_on(const SpringRows& rows, const EdgeStiffness* edge,
                                           const float* home_N_per_m, const Lanes* direction,
                                           Lanes* product, Float4* dot) noexcept {
  const Float4 all_lanes = broadcast(1.0F);
  Float4 sum{};
  for (std::int32_t i = 0; i < rows.active; ++i) {
    const Float4 p[3] = {direction[i].component[0], direction[i].component[1],
                         direction[i].component[2]};
    Float4 q[3] = {product[i].component[0], product[i].component[1], product[i].component[2]};
    if (home_N_per_m != nullptr) {
      for (int c = 0; c < 3; ++c) {
        q[c] += broadcast(home_N_per_m[i]) * p[c];
      }
    }
    add_edge_row<1>(rows.row_begin[static_cast<std::size_t>(i)],
                    rows.row_begin[static_cast<std::size_t>(i) + 1], rows.other.data(), edge,
                    direction, all_lanes, p, q, product);
    for (int c = 0; c < 3; ++c) {
      product[i].component[c] = q[c];
      sum += p[c] * q[c];
    }
  }
  *dot = sum;
}

}  // namespace

void add_elements(const ElementBatch<float>& batch, std::size_t count, const Single* position,
                  Precise* force, Lanes* residual, EdgeStiffness* edge) noexcept {
  const auto add = batch.model == ElementModel::kCorotated           ? add_corotated
                   : batch.model == ElementModel::kStVenantKirchhoff ? add_stvk
                                                                     : add_neo_hookean;
  add(batch, count, position, force, residual, edge);
}

void add_elements(const ElementBatch<double>& batch, std::size_t count, const Precise* position,
                  Precise* force, Lanes* residual, EdgeStiffness* edge) noexcept {
  const auto add = batch.model == ElementModel::kCorotated           ? add_precise_corotated
                   : batch.model == ElementModel::kStVenantKirchhoff ? add_precise_stvk
                                                                     : add_precise_neo_hookean;
  add(batch, count, position, force, residual, edge);
}

void add_edge_residuals(const SpringRows& rows, const EdgeStiffness* edge, const Lanes* state,
                        Lanes* residual) noexcept {
  add_edge_residuals_of(rows, edge, state, residual);
}

void add_edge_blocks(const SpringRows& rows, const EdgeStiffness* edge,
                     BlockInverse* block) noexcept {
  add_edge_blocks_of(rows, edge, block);
}

Float4 apply_edges(const SpringRows& rows, const EdgeStiffness* edge, const float* home_N_per_m,
                   const Lanes* direction, Lanes* product) noexcept {
  Float4 dot{};
  apply_edges_on(rows, edge, home_N_per_m, direction, product, &dot);
  return dot;
}

}  // namespace forcegrid::simulator::kernels
