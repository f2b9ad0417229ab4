// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/rivals/model_method.h"

namespace forcegrid::simulator {

/// The surface at rest and one stiffness for all of it.
struct PenetrationTable {
  struct Facet {
    Eigen::Vector3d centre_W;  ///< [m]
    Eigen::Vector3d area_W;    ///< [m^2] outward normal times area
  };
  std::vector<Facet> facets;
  double longest_edge_m = 0.0;     ///< of the triangles
  double patch_radius_m = 0.0;     ///< over which the normal is averaged
  double stiffness_N_per_m = 0.0;  ///< k
};

/// k is the object's own at rest along the normal n at SpringMesh::top_W, for a tool that holds the
/// patch there: k = -n^T J n (rest_stiffness_W).
/// Throws Error for a mesh that check() refuses or that has no surface, and for a patch without a
/// free vertex.
std::shared_ptr<const PenetrationTable> make_penetration_table(const SpringMesh& mesh,
                                                               double patch_radius_m);

/// Force by penetration depth: a spring along the normal n of the rest surface at the contact,
///
///   F = -k (n . d) n
///
/// whatever the object's shape and law. n is the mean over the surface within the patch. A pull is
/// answered as a push, because the contact of this project holds. Right for pushes along the normal
/// that are small, on an object that is equally stiff everywhere; it knows no tangential force.
/// A contact farther from the surface than patch and triangle are large is not covered.
/// Source: Basdogan, Ho, Srinivasan, Small and Dawson, Force interaction in laparoscopic
/// simulation, MMVR 1998: the idea of a force in proportion to the depth below the rest surface.
/// Cost per contact: one pass over the surface's triangles. Memory: 48 bytes per triangle.
/// Real-time: everything after construction.
class PenetrationDepthMethod final : public ModelMethod {
 public:
  explicit PenetrationDepthMethod(std::shared_ptr<const PenetrationTable> table);

  const char* name() const noexcept override { return "penetration-depth"; }
  /// The shared table included.
  std::size_t memory_bytes() const noexcept override;

 private:
  bool hold(const Eigen::Vector3d& point_W) noexcept override;
  [[nodiscard]] Eigen::Vector3d response_N(
      const Eigen::Vector3d& displacement_W) const noexcept override;

  std::shared_ptr<const PenetrationTable> table_;
  Eigen::Vector3d normal_W_ = Eigen::Vector3d::UnitZ();
};

}  // namespace forcegrid::simulator
