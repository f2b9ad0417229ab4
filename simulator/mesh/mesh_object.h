// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "simulator/mesh/mesh_file.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// The material of a mesh's tetrahedra in one of its regions.
struct RegionMaterial {
  std::string region;  ///< one of MeshFile::regions
  ElementMaterial material;
};

/// An object made of a mesh from a file. Without a material every edge of its triangles or
/// tetrahedra is a spring; with one every tetrahedron is a finite element.
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
  /// Of the tetrahedra that no entry of `region_materials` names.
  std::optional<ElementMaterial> material;
  std::vector<RegionMaterial> region_materials;

  bool has_elements() const noexcept { return material || !region_materials.empty(); }
};

/// A surface whose triangles all face inward is turned outward. Tetrahedra that become springs may
/// have any orientation; their outer faces are the surface.
/// Throws Error for a mesh that is not between 5 mm and 1 m long, an edge with more than two
/// triangles or with two that disagree about which side is outside, a tetrahedron without volume,
/// or no surface above the middle of the box. For elements also: no tetrahedra, one that is
/// inverted or whose quality (element_quality()) is below 0.01, one without a material, or a region
/// that the file does not have.
SpringMesh make_mesh_object(const MeshFile& file, const MeshObjectOptions& options);

}  // namespace forcegrid::simulator
