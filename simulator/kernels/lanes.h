// SPDX-License-Identifier: Apache-2.0
#pragma once

// The types that all kernels work on.
namespace forcegrid::simulator::kernels {

/// Four numbers side by side, one SIMD register (GCC and Clang vector extension).
/// Lane 0 belongs to the positions, lanes 1 to 3 to the columns of the sensitivity S = dx/dP.
using Float4 = float __attribute__((vector_size(16)));
using Double4 = double __attribute__((vector_size(32)));

/// One vertex's position [m] or force [N] in double precision; w is 0. A class, since a container
/// of bare vector types would lose their alignment.
struct alignas(32) Precise {
  Double4 xyz;
};
struct alignas(16) Single {
  Float4 xyz;
};

/// The three components of one vertex, four lanes each: component[c][0] = x_c (or r_c),
/// component[c][1 + j] = dx_c / dP_j.
struct Lanes {
  Float4 component[3];
};

/// The symmetric 3 x 3 inverse of a vertex's diagonal block of K, and 1 for a free vertex; all zero
/// for a vertex that can't move freely.
struct BlockInverse {
  Float4 diagonal;      ///< xx, yy, zz, 1 if free
  Float4 off_diagonal;  ///< xy, yz, zx, 0
};

}  // namespace forcegrid::simulator::kernels
