// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A closed surface like a stomach's: an ellipsoid, its long axis along y, bent so that its ends
/// hang down, made of rings of vertices joined by strips of triangles.
///
/// V vertices in triangles have 3 V - 6 edges. If `edge_count` is smaller, edges between rings are
/// left out and pairs of triangles become quadrilaterals: no two at one vertex while that is
/// possible, none near the top or the fixed ends. If it is larger, struts, which resist bending,
/// join the opposite corners of adjacent triangles.
///
/// The surface is anchored: both ends are fixed, every vertex has a home spring, and all springs
/// are stretched by `pre_strain` at rest, balanced by dead loads, a turgor. Without home springs
/// and pre-strain a surface wrinkles, and its force is not a function of the tool's position (the
/// solver study).
struct OrganOptions {
  int vertex_count = 4000;                           ///< 200..1'000'000
  int edge_count = 11000;                            ///< springs, at most 6 V - 12
  Eigen::Vector3d semi_axes_m{0.036, 0.050, 0.030};  ///< along x, y, z; each > 0
  double bend_m = 0.010;                             ///< how far the ends hang down; >= 0
  Eigen::Vector3d top_W =
      Eigen::Vector3d::Zero();     ///< [m] the surface point above the ellipsoid's centre
  double stiffness_N_per_m = 8.0;  ///< k of an edge before the random part; > 0
  double strut_factor = 0.7;       ///< a strut's k relative to an edge's; > 0
  double random_spread = 0.2;      ///< see LatticeBlockOptions
  std::uint64_t seed = 1;   ///< of the random part, the rings' turns, and which edges are left out
  double pre_strain = 0.3;  ///< of every spring at rest; >= 0
  double home_stiffness_N_per_m = 0.8;  ///< >= 0
  SpringLaw law{.cubic_coefficient = 5.0};
};

/// Generates the surface. The same options give the same vertices, springs and stiffnesses on every
/// processor and with any compiler flags: positions are multiples of 2^-30 m, and integer
/// arithmetic decides which vertices are joined.
/// Throws Error naming the option that is out of range.
SpringMesh make_organ_surface(const OrganOptions& options);

}  // namespace forcegrid::simulator
