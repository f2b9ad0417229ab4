// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/coarse_correction.h"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace forcegrid::simulator {
namespace {

constexpr std::size_t kFewestVertices = 500;
// Target up to kCellsUpTo vertices: more cells save iterations but cost a denser solve. For larger
// objects it grows as the cost of an iteration to the power of 2/3.
constexpr double kCells = 27.0;
constexpr double kCellsUpTo = 4'000.0;
constexpr int kMaxCellsPerAxis = 8;
// Without it, nodes that no free vertex sees, and rounding, leave P^T K P singular.
constexpr float kRelativeRegularisation = 1e-5F;

using kernels::CoarsePlace;

struct Hats {
  std::array<std::int32_t, 8> node;
  std::array<float, 8> weight;
};

Hats hats(const kernels::CoarseGrid& coarse, const CoarsePlace& place) {
  Hats result;
  for (int k = 0; k < 8; ++k) {
    const bool x = (k & 1) != 0;
    const bool y = (k & 2) != 0;
    const bool z = (k & 4) != 0;
    const auto at = static_cast<std::size_t>(k);
    result.node[at] =
        place.corner + (x ? 1 : 0) + (y ? coarse.stride_y : 0) + (z ? coarse.stride_z : 0);
    result.weight[at] = (x ? place.u : 1.0F - place.u) * (y ? place.v : 1.0F - place.v) *
                        (z ? place.w : 1.0F - place.w);
  }
  return result;
}

// The hats that a pair of vertices sees, and their weights at either of them; a vertex that can't
// move sees none.
struct PairHats {
  PairHats(const Hats& at_lower, bool lower_free, const Hats& at_upper, bool upper_free) {
    for (std::size_t k = 0; k < 8; ++k) {
      if (lower_free) {
        lower[place_of(at_lower.node[k])] += at_lower.weight[k];
      }
    }
    for (std::size_t k = 0; k < 8; ++k) {
      if (upper_free) {
        upper[place_of(at_upper.node[k])] += at_upper.weight[k];
      }
    }
  }

  std::size_t place_of(std::int32_t wanted) {
    for (std::size_t k = 0; k < count; ++k) {
      if (node[k] == wanted) {
        return k;
      }
    }
    node[count] = wanted;
    return count++;
  }

  std::size_t count = 0;
  std::array<std::int32_t, 16> node{};
  std::array<float, 16> lower{};
  std::array<float, 16> upper{};
};

void sort_by_cell(kernels::CoarseGrid& coarse) {
  std::vector<std::int32_t> order(coarse.place.size());
  std::iota(order.begin(), order.end(), 0);
  const auto corner = [&coarse](std::int32_t i) {
    return coarse.place[static_cast<std::size_t>(i)].corner;
  };
  std::stable_sort(order.begin(), order.end(),
                   [&corner](std::int32_t a, std::int32_t b) { return corner(a) < corner(b); });
  for (const std::int32_t i : order) {
    const auto members = static_cast<std::int32_t>(coarse.member.size());
    if (coarse.cell.empty() || coarse.cell.back().corner != corner(i)) {
      coarse.cell.push_back({corner(i), members, members});
    }
    const CoarsePlace& place = coarse.place[static_cast<std::size_t>(i)];
    coarse.member.push_back({i, place.u, place.v, place.w});
    coarse.cell.back().end = members + 1;
  }
}

}  // namespace

kernels::CoarseGrid make_coarse_grid(const std::vector<Eigen::Vector3d>& rest) {
  kernels::CoarseGrid coarse;
  if (rest.size() < kFewestVertices) {
    return coarse;
  }
  Eigen::Array3d low = rest.front().array();
  Eigen::Array3d high = low;
  for (const Eigen::Vector3d& position : rest) {
    low = low.min(position.array());
    high = high.max(position.array());
  }
  const Eigen::Array3d extent_m = (high - low).max(1e-9 * (high - low).maxCoeff());
  const double size = std::max(1.0, static_cast<double>(rest.size()) / kCellsUpTo);
  const double edge_m = std::cbrt(extent_m.prod() / (kCells * std::pow(size, 2.0 / 3.0)));
  Eigen::Array3i cells;
  for (int axis = 0; axis < 3; ++axis) {
    cells[axis] =
        std::clamp(static_cast<int>(std::lround(extent_m[axis] / edge_m)), 1, kMaxCellsPerAxis);
  }
  coarse.stride_y = cells[0] + 1;
  coarse.stride_z = coarse.stride_y * (cells[1] + 1);
  coarse.node_count = coarse.stride_z * (cells[2] + 1);
  coarse.place.reserve(rest.size());
  for (const Eigen::Vector3d& position : rest) {
    const Eigen::Array3d at = (position.array() - low) / extent_m * cells.cast<double>();
    const Eigen::Array3i cell = at.floor().cast<int>().min(cells - 1).max(0);
    const Eigen::Array3f within = (at - cell.cast<double>()).cast<float>();
    coarse.place.push_back({cell[0] + coarse.stride_y * cell[1] + coarse.stride_z * cell[2],
                            within[0], within[1], within[2]});
  }
  sort_by_cell(coarse);
  const auto unknowns = static_cast<std::size_t>(3 * coarse.node_count);
  coarse.inverse_m_per_N.resize(unknowns * unknowns);
  return coarse;
}

void add_coarse_stiffness(const kernels::SpringRows& rows,
                          const std::vector<kernels::SpringTangent>& tangent,
                          const std::vector<std::uint8_t>& free, const kernels::CoarseGrid& coarse,
                          Eigen::MatrixXf& stiffness) {
  // A spring pulls at each hat with the hat's difference between the spring's ends.
  std::array<std::int32_t, 16> node{};
  std::array<float, 16> difference{};
  for (std::int32_t a = 0; a < rows.vertex_count(); ++a) {
    const auto i = static_cast<std::size_t>(a);
    const Hats here = hats(coarse, coarse.place[i]);
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const auto at = static_cast<std::size_t>(s);
      const auto j = static_cast<std::size_t>(rows.other[at]);
      if (free[i] == 0 && free[j] == 0) {
        continue;
      }
      int count = 0;
      const auto add = [&node, &difference, &count](std::int32_t n, float d) {
        for (int k = 0; k < count; ++k) {
          if (node[static_cast<std::size_t>(k)] == n) {
            difference[static_cast<std::size_t>(k)] += d;
            return;
          }
        }
        node[static_cast<std::size_t>(count)] = n;
        difference[static_cast<std::size_t>(count)] = d;
        ++count;
      };
      if (free[i] != 0) {
        for (std::size_t k = 0; k < 8; ++k) {
          add(here.node[k], here.weight[k]);
        }
      }
      if (free[j] != 0) {
        const Hats there = hats(coarse, coarse.place[j]);
        for (std::size_t k = 0; k < 8; ++k) {
          add(there.node[k], -there.weight[k]);
        }
      }
      const Eigen::Vector3f w(tangent[at].w_x, tangent[at].w_y, tangent[at].w_z);
      Eigen::Matrix3f tangent_stiffness = w * w.transpose();
      tangent_stiffness.diagonal().array() += std::max(tangent[at].t_N_per_m, 0.0F);
      for (int k = 0; k < count; ++k) {
        const auto row = static_cast<std::size_t>(k);
        if (difference[row] == 0.0F) {
          continue;
        }
        for (int m = 0; m < count; ++m) {
          const auto column = static_cast<std::size_t>(m);
          if (node[column] <= node[row]) {
            stiffness.block<3, 3>(3 * node[row], 3 * node[column]) +=
                difference[row] * difference[column] * tangent_stiffness;
          }
        }
      }
    }
  }
}

void add_coarse_stiffness(const kernels::SpringRows& rows,
                          const std::vector<kernels::EdgeStiffness>& edge,
                          const std::vector<std::uint8_t>& free, const kernels::CoarseGrid& coarse,
                          Eigen::MatrixXf& stiffness) {
  for (std::int32_t a = 0; a < rows.vertex_count(); ++a) {
    const auto i = static_cast<std::size_t>(a);
    const Hats lower = hats(coarse, coarse.place[i]);
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const auto at = static_cast<std::size_t>(s);
      const auto j = static_cast<std::size_t>(rows.other[at]);
      if (free[i] == 0 && free[j] == 0) {
        continue;
      }
      const PairHats pair(lower, free[i] != 0, hats(coarse, coarse.place[j]), free[j] != 0);
      Eigen::Matrix3f h;
      for (int c = 0; c < 3; ++c) {
        for (int d = 0; d < 3; ++d) {
          h(c, d) = edge[at].row[c][d];
        }
      }
      for (std::size_t row = 0; row < pair.count; ++row) {
        const Eigen::Matrix3f pull = pair.lower[row] * h - pair.upper[row] * h.transpose();
        for (std::size_t column = 0; column < pair.count; ++column) {
          if (pair.node[column] <= pair.node[row]) {
            stiffness.block<3, 3>(3 * pair.node[row], 3 * pair.node[column]) +=
                (pair.lower[column] - pair.upper[column]) * pull;
          }
        }
      }
    }
  }
}

void finish_coarse(Eigen::MatrixXf& stiffness,
                   const std::vector<kernels::VertexForce>& vertex_force,
                   const std::vector<std::uint8_t>& free, kernels::CoarseGrid& coarse) {
  for (std::size_t i = 0; i < vertex_force.size(); ++i) {
    if (free[i] == 0 || vertex_force[i].home_stiffness_N_per_m == 0.0F) {
      continue;
    }
    const Hats here = hats(coarse, coarse.place[i]);
    for (std::size_t k = 0; k < 8; ++k) {
      for (std::size_t m = 0; m < 8; ++m) {
        stiffness.block<3, 3>(3 * here.node[k], 3 * here.node[m]).diagonal().array() +=
            here.weight[k] * here.weight[m] * vertex_force[i].home_stiffness_N_per_m;
      }
    }
  }
  const Eigen::Index unknowns = stiffness.rows();
  const float scale = stiffness.diagonal().maxCoeff();
  stiffness.diagonal().array() += kRelativeRegularisation * scale;
  const Eigen::LLT<Eigen::MatrixXf> factor(stiffness);
  const Eigen::MatrixXf inverse = factor.solve(Eigen::MatrixXf::Identity(unknowns, unknowns));
  if (factor.info() != Eigen::Success || !inverse.allFinite()) {
    // Block-Jacobi alone converges too, but later.
    std::fill(coarse.inverse_m_per_N.begin(), coarse.inverse_m_per_N.end(), 0.0F);
    return;
  }
  // Conjugate gradients need a symmetric preconditioner to the last digit.
  Eigen::Map<Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      coarse.inverse_m_per_N.data(), unknowns, unknowns) = 0.5F * (inverse + inverse.transpose());
}

Eigen::MatrixXf begin_coarse(const kernels::CoarseGrid& coarse) {
  const Eigen::Index unknowns = 3 * Eigen::Index{coarse.node_count};
  return Eigen::MatrixXf::Zero(unknowns, unknowns);
}

void invert_coarse(const kernels::SpringRows& rows,
                   const std::vector<kernels::SpringTangent>& tangent,
                   const std::vector<kernels::VertexForce>& vertex_force,
                   const std::vector<std::uint8_t>& free, kernels::CoarseGrid& coarse) {
  if (coarse.place.empty()) {
    return;
  }
  Eigen::MatrixXf stiffness = begin_coarse(coarse);
  add_coarse_stiffness(rows, tangent, free, coarse, stiffness);
  finish_coarse(stiffness, vertex_force, free, coarse);
}

}  // namespace forcegrid::simulator
