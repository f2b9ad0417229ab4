// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>

#include "simulator/mesh/mesh_file.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// An object made of a mesh from a file: every edge of its triangles or tetrahedra is a spring.
struct MeshObjectOptions {
  std::string who = "mesh: ";  ///< begins every message
  double unit_m = 1.0;         ///< the file's unit of length
  /// [m] Where to put the surface point above the middle of the object's box.
  Eigen::Vector3d top_W = Eigen::Vector3d::Zero();
  double fixed_below_m = 0.0;      ///< vertices at most this far above the lowest one are fixed
  double stiffness_N_per_m = 0.0;  ///< k of every spring before the random part; > 0
  double random_spread = 0.0;      ///< see LatticeBlockOptions
  std::uint64_t seed = 1;
  double pre_strain = 0.0;              ///< see tighten()
  double home_stiffness_N_per_m = 0.0;  ///< see tighten()
  SpringLaw law;
};

/// A surface whose triangles all face inward is turned outward. Tetrahedra may have any
/// orientation; their outer faces are the surface.
/// Throws Error for a mesh that is not between 5 mm and 1 m long, an edge with more than two
/// triangles or with two that disagree about which side is outside, a tetrahedron without volume,
/// or no surface above the middle of the box.
SpringMesh make_mesh_object(const MeshFile& file, const MeshObjectOptions& options);

}  // namespace forcegrid::simulator
