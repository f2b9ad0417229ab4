#include "simulator/kernel_support.h"

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
