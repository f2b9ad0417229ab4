// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/rivals/model_method.h"

namespace forcegrid::simulator {

struct UnitResponseOptions {
  double patch_radius_m = 0.012;  ///< of the tool's grip; > 0
  /// [m] Where the tool will touch; empty: SpringMesh::top_W alone.
  std::vector<Eigen::Vector3d> places_W;
  /// [m] Length h of each unit displacement; > 0. The force is exact at this distance along an
  /// axis.
  double step_m = 0.005;
};

/// The forces for six displacements of the patch at each place.
struct UnitResponseTable {
  struct Place {
    Eigen::Vector3d point_W;  ///< [m]
    /// [N] Forces at step along +x, +y, +z, and along -x, -y, -z.
    Eigen::Matrix<double, 3, 6> force_W;
  };
  std::vector<Place> places;
  double patch_radius_m = 0.0;
  double step_m = 0.0;
};

/// Solves the object, with its own non-linear laws, for six displacements at each place, to a
/// relative residual of 1e-6 in double precision.
/// Throws Error for a mesh that check() refuses, options out of range, a place without a free
/// vertex, or a displacement at which the object has no equilibrium near.
std::shared_ptr<const UnitResponseTable> make_unit_responses(const SpringMesh& mesh,
                                                             const UnitResponseOptions& options);

/// Pre-computed unit responses, superposed: with the step h and the responses F_j+ and F_j- to
/// displacements of h along and against axis j,
///
///   F(d) = sum_j |d_j| / h F_j(sign d_j)
///
/// A contact takes the nearest place; farther from every place than the patch radius it is not
/// covered. Right for linear objects, and for others near the distance h along an axis, where the
/// contact point is known before the run. Oblique displacements of a non-linear object, and those
/// much shorter or longer than h, are wrong by what superposition leaves out.
/// Source: Cotin, Delingette and Ayache, Real-time elastic deformations of soft tissues for surgery
/// simulation, IEEE TVCG 5(1), 1999: responses of the nodes to elementary displacements, combined
/// linearly. Their responses were of a linear object.
/// Real-time: everything after construction.
class UnitResponseMethod final : public ModelMethod {
 public:
  explicit UnitResponseMethod(std::shared_ptr<const UnitResponseTable> table);

  const char* name() const noexcept override { return "unit-responses"; }
  /// The shared table included.
  std::size_t memory_bytes() const noexcept override;

 private:
  bool hold(const Eigen::Vector3d& point_W) noexcept override;
  [[nodiscard]] Eigen::Vector3d response_N(
      const Eigen::Vector3d& displacement_W) const noexcept override;

  std::shared_ptr<const UnitResponseTable> table_;
  const UnitResponseTable::Place* place_ = nullptr;
};

}  // namespace forcegrid::simulator
