// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "simulator/kernels/lanes.h"
#include "simulator/kernels/spring_laws.h"
#include "simulator/mesh/element_material.h"

namespace forcegrid::simulator::kernels {

/// Bytes of a SIMD register of elements: as many side by side as fit.
inline constexpr std::size_t kElementRegister = 32;
template <typename Real>
inline constexpr std::size_t kElementsSideBySide = kElementRegister / sizeof(Real);

/// What elements side by side are made of, number by number. `stiffness` is (mu, lambda, -), or
/// (m, l, a) of a neo-Hookean material.
template <typename Real>
struct alignas(kElementRegister) ElementConstants {
  Real gradient_per_m[3][3][kElementsSideBySide<Real>];  ///< of corners 1 to 3
  Real volume_m3[kElementsSideBySide<Real>];
  Real stiffness[3][kElementsSideBySide<Real>];
};

/// The pairs of an element's corners, in the order of ElementCorners::edge.
inline constexpr std::array<std::array<int, 2>, 6> kElementEdges{
    {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}};

/// An element's corners, sorted by their numbers, and the edges between them as places in the rows
/// of all edges.
struct ElementCorners {
  std::array<std::int32_t, 4> vertex;
  std::array<std::int32_t, 6> edge;
};

/// Elements of one energy, sorted by their lowest vertex. The last group of constants is filled up
/// with its last element.
template <typename Real>
struct ElementBatch {
  ElementModel model = ElementModel::kCorotated;
  std::vector<ElementCorners> corners;
  std::vector<ElementConstants<Real>> constants;
  std::vector<std::int32_t> begin;  ///< per vertex: elements whose lowest vertex is a smaller one
};

/// H of a pair of vertices, see ForceModel: row c, component 3 unused.
struct EdgeStiffness {
  Float4 row[3];
};

/// Adds the forces of a batch's first `count` elements to lane 0 of `residual` (float) or to
/// `force` (double), and their H to `edge`. Positions from any origin near the object.
void add_elements(const ElementBatch<float>& batch, std::size_t count, const Single* position,
                  Precise* force, Lanes* residual, EdgeStiffness* edge) noexcept;
void add_elements(const ElementBatch<double>& batch, std::size_t count, const Precise* position,
                  Precise* force, Lanes* residual, EdgeStiffness* edge) noexcept;

/// What ForceModel does with H; the rows are those of the edges.
void add_edge_residuals(const SpringRows& rows, const EdgeStiffness* edge, const Lanes* state,
                        Lanes* residual) noexcept;
void add_edge_blocks(const SpringRows& rows, const EdgeStiffness* edge,
                     BlockInverse* block) noexcept;
Float4 apply_edges(const SpringRows& rows, const EdgeStiffness* edge, const float* home_N_per_m,
                   const Lanes* direction, Lanes* product) noexcept;

}  // namespace forcegrid::simulator::kernels
