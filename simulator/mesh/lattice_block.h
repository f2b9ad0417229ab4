// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A box cut into a lattice of vertices, joined by springs along the lattice's edges (structural)
/// and both diagonals of each lattice face.
///
/// Without the diagonals a lattice is nearly a mechanism, and its force is not a function of the
/// tool's position. nx x ny x nz vertices give
///
///   structural  (nx-1) ny nz + nx (ny-1) nz + nx ny (nz-1)
///   diagonals   2 [(nx-1)(ny-1) nz + (nx-1) ny (nz-1) + nx (ny-1)(nz-1)]
///
/// springs: 84,566 for the default 22 x 22 x 21 = 10,164 vertices. Vertex (i, j, l) has the number
/// i + nx (j + ny l), l = 0 is the bottom layer, which is fixed. All six sides can be touched.
struct LatticeBlockOptions {
  std::array<int, 3> vertex_count{22, 22, 21};             ///< along x, y, z; each in 2..1000
  Eigen::Vector3d size_m{0.1, 0.1, 0.1};                   ///< each > 0
  Eigen::Vector3d top_centre_W = Eigen::Vector3d::Zero();  ///< [m] centre of the top face
  double stiffness_N_per_m = 10.0;  ///< k of a structural spring before the random part; > 0
  double diagonal_factor = 0.7;     ///< a diagonal's k relative to a structural spring's; > 0
  double random_spread = 0.3;       ///< each k is multiplied by 1 + spread * U[-1, 1); in [0, 1)
  std::uint64_t seed = 1;           ///< of the random part
  SpringLaw law{.cubic_coefficient = 5.0};
};

/// Generates the block. The same options give the same numbers on every platform: spring s (in the
/// order of generation) takes U = spring_random(seed, s).
/// Throws Error naming the option that is out of range.
SpringMesh make_lattice_block(const LatticeBlockOptions& options);

/// Number `index` of the random sequence `seed`: uniform in [-1, 1), a multiple of 2^-52.
/// SplitMix64's output function at the state seed + (index + 1) * 0x9E3779B97F4A7C15.
/// Source: Steele, Lea and Flood, Fast splittable pseudorandom number generators, OOPSLA 2014;
/// constants of variant 13 of Stafford's mixers.
double spring_random(std::uint64_t seed, std::uint64_t index) noexcept;

}  // namespace forcegrid::simulator
