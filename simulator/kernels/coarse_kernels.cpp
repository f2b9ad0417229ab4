// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/coarse_kernels.h"

#include "simulator/kernels/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

// A cell's eight corners as four pairs along x, with two neighbouring nodes in one register; a
// pair's weight is that along x times v or 1 - v and w or 1 - w.
constexpr int kPairs = 4;

FORCEGRID_INLINE std::int32_t first_of_pair(const CoarseGrid& coarse, const CoarseCell& cell,
                                            int pair) {
  return cell.corner + ((pair & 1) != 0 ? coarse.stride_y : 0) +
         ((pair & 2) != 0 ? coarse.stride_z : 0);
}

FORCEGRID_INLINE void find_weights(const CoarseMember& member, Float8 (&weight)[kPairs]) {
  const Float4 u1 = broadcast(member.u);
  const Float4 u0 = broadcast(1.0F - member.u);
  const Float8 along_x = FORCEGRID_PAIR(u0, u1);
  const float v[2] = {1.0F - member.v, member.v};
  const float w[2] = {1.0F - member.w, member.w};
  for (int pair = 0; pair < kPairs; ++pair) {
    weight[pair] = along_x * (v[pair & 1] * w[pair >> 1]);
  }
}

FORCEGRID_MULTIVERSION void restrict_on(const CoarseGrid& coarse, const Lanes* residual,
                                        Lanes* coarse_residual) noexcept {
  for (std::int32_t k = 0; k < coarse.node_count; ++k) {
    coarse_residual[k] = Lanes{};
  }
  for (const CoarseCell& cell : coarse.cell) {
    Float8 sum[kPairs][3] = {};
    for (std::int32_t m = cell.begin; m < cell.end; ++m) {
      const CoarseMember& member = coarse.member[static_cast<std::size_t>(m)];
      Float8 weight[kPairs];
      find_weights(member, weight);
      for (int c = 0; c < 3; ++c) {
        const Float4 r = residual[member.vertex].component[c];
        const Float8 both = FORCEGRID_PAIR(r, r);
        for (int pair = 0; pair < kPairs; ++pair) {
          sum[pair][c] += weight[pair] * both;
        }
      }
    }
    for (int pair = 0; pair < kPairs; ++pair) {
      const std::int32_t node = first_of_pair(coarse, cell, pair);
      for (int c = 0; c < 3; ++c) {
        coarse_residual[node].component[c] += FORCEGRID_LOW(sum[pair][c]);
        coarse_residual[node + 1].component[c] += FORCEGRID_HIGH(sum[pair][c]);
      }
    }
  }
}

FORCEGRID_MULTIVERSION void next_direction_by_cell(const CoarseGrid& coarse, const Float4* beta,
                                                   const BlockInverse* inverse,
                                                   const Lanes* coarse_correction, Lanes* direction,
                                                   Lanes* product) noexcept {
  for (const CoarseCell& cell : coarse.cell) {
    Float8 corner[kPairs][3];
    for (int pair = 0; pair < kPairs; ++pair) {
      const std::int32_t node = first_of_pair(coarse, cell, pair);
      for (int c = 0; c < 3; ++c) {
        corner[pair][c] = FORCEGRID_PAIR(coarse_correction[node].component[c],
                                         coarse_correction[node + 1].component[c]);
      }
    }
    for (std::int32_t m = cell.begin; m < cell.end; ++m) {
      const CoarseMember& member = coarse.member[static_cast<std::size_t>(m)];
      const Float4 free = broadcast(inverse[member.vertex].diagonal[3]);
      Lanes& d = direction[member.vertex];
      Lanes& z = product[member.vertex];
      Float8 weight[kPairs];
      find_weights(member, weight);
      for (int c = 0; c < 3; ++c) {
        Float8 e{};
        for (int pair = 0; pair < kPairs; ++pair) {
          e += weight[pair] * corner[pair][c];
        }
        d.component[c] =
            z.component[c] + free * (FORCEGRID_LOW(e) + FORCEGRID_HIGH(e)) + *beta * d.component[c];
        z.component[c] = Float4{};
      }
    }
  }
}

// Rows of the inverse that are computed side by side: two wide registers per lane.
constexpr std::int32_t kRows = 16;

// kRows unknowns from `first` on; the matrix is symmetric, so that its rows are its columns.
FORCEGRID_INLINE void solve_rows(const CoarseGrid& coarse, std::int32_t first,
                                 const Lanes* coarse_residual, Lanes* coarse_correction) {
  const std::int32_t unknowns = 3 * coarse.node_count;
  const float* row = &coarse.inverse_m_per_N[static_cast<std::size_t>(first)];
  Float8 low[4] = {};
  Float8 high[4] = {};
  for (std::int32_t n = 0; n < coarse.node_count; ++n) {
    for (int c = 0; c < 3; ++c) {
      const Float4 r = coarse_residual[n].component[c];
      const auto low_row = load<Float8>(row);
      const auto high_row = load<Float8>(row + 8);
      for (int lane = 0; lane < 4; ++lane) {
        low[lane] += low_row * r[lane];
        high[lane] += high_row * r[lane];
      }
      row += unknowns;
    }
  }
  for (std::int32_t k = 0; k < kRows; ++k) {
    const Float8(&sum)[4] = k < 8 ? low : high;
    const int at = k % 8;
    coarse_correction[(first + k) / 3].component[(first + k) % 3] =
        Float4{sum[0][at], sum[1][at], sum[2][at], sum[3][at]};
  }
}

FORCEGRID_MULTIVERSION void solve_coarse_on(const CoarseGrid& coarse, const Lanes* coarse_residual,
                                            Lanes* coarse_correction, Float4* dot) noexcept {
  const std::int32_t unknowns = 3 * coarse.node_count;
  std::int32_t first = 0;
  for (; first + kRows <= unknowns; first += kRows) {
    solve_rows(coarse, first, coarse_residual, coarse_correction);
  }
  for (; first < unknowns; ++first) {
    const float* const row =
        &coarse
             .inverse_m_per_N[static_cast<std::size_t>(first) * static_cast<std::size_t>(unknowns)];
    Float4 e{};
    for (std::int32_t n = 0; n < coarse.node_count; ++n) {
      for (int c = 0; c < 3; ++c) {
        e += broadcast(row[3 * n + c]) * coarse_residual[n].component[c];
      }
    }
    coarse_correction[first / 3].component[first % 3] = e;
  }
  Float4 sum{};
  for (std::int32_t n = 0; n < coarse.node_count; ++n) {
    for (int c = 0; c < 3; ++c) {
      sum += coarse_correction[n].component[c] * coarse_residual[n].component[c];
    }
  }
  *dot = sum;
}

}  // namespace

void restrict_residual(const CoarseGrid& coarse, const Lanes* residual,
                       Lanes* coarse_residual) noexcept {
  if (!coarse.place.empty()) {
    restrict_on(coarse, residual, coarse_residual);
  }
}

Float4 solve_coarse(const CoarseGrid& coarse, const Lanes* coarse_residual,
                    Lanes* coarse_correction) noexcept {
  Float4 dot{};
  if (!coarse.place.empty()) {
    solve_coarse_on(coarse, coarse_residual, coarse_correction, &dot);
  }
  return dot;
}

void next_direction_with(const CoarseGrid& coarse, Float4 beta, const BlockInverse* inverse,
                         const Lanes* coarse_correction, Lanes* direction,
                         Lanes* product) noexcept {
  next_direction_by_cell(coarse, &beta, inverse, coarse_correction, direction, product);
}

}  // namespace forcegrid::simulator::kernels
