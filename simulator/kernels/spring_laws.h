// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "simulator/kernels/lanes.h"

namespace forcegrid::simulator::kernels {

/// How much of the object the kernels work on: the rows of the vertices below `active` alone, which
/// lead to vertices below `reach`. Both are the number of vertices unless a part is solved by
/// itself.
struct Extent {
  std::int32_t active = 0;
  std::int32_t reach = 0;
};

/// The springs, sorted by their lower vertex: those of vertex i are row_begin[i] .. row_begin[i +
/// 1] - 1 and lead from owner[] = i to other[] > i. Both lists, and every array with one entry per
/// spring, are padded to a multiple of kSpringPadding with springs from vertex 0 to itself that no
/// row contains.
struct SpringRows : Extent {
  std::vector<std::int32_t> row_begin;
  std::vector<std::int32_t> owner;
  std::vector<std::int32_t> other;
  std::int32_t vertex_count() const { return static_cast<std::int32_t>(row_begin.size()) - 1; }
};
inline constexpr std::size_t kSpringPadding = 16;

/// The constants of one spring with f = k l0 (sinh(a e) / a + c e^3), e = l / l0 - 1, where sinh(a
/// e) / a is e for a = 0.
template <typename Real>
struct SpringConstants {
  Real inverse_length_per_m;  ///< 1 / l0
  Real scale_N;               ///< k l0
  Real cubic;                 ///< c
  Real exponent;              ///< a; read only if evaluate() has `exponential` set
};

/// What a spring contributes to K at the current state: H = w w^T + t I, with
/// w = sqrt(f' - f/l) u, u the unit vector along it and t = f / l. f' >= f/l for every law.
struct SpringTangent {
  float w_x, w_y, w_z;
  float t_N_per_m;
};

/// The first half of evaluate(): every spring's tangent at the present positions.
void find_tangents(const SpringRows& rows, const SpringConstants<float>* constants,
                   bool exponential, const Single* position, SpringTangent* tangent) noexcept;
void find_tangents(const SpringRows& rows, const SpringConstants<double>* constants,
                   bool exponential, const Precise* position, double* t_N_per_m,
                   SpringTangent* tangent) noexcept;

}  // namespace forcegrid::simulator::kernels
