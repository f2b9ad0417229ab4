// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A cut from above around a square column: its sides are at `half_width_m` from `centre_W` along x
/// and y, and it ends `depth_m` below it.
struct ColumnCut {
  Eigen::Vector3d centre_W = Eigen::Vector3d::Zero();  ///< [m]
  double half_width_m = 0.018;                         ///< > 0
  double depth_m = 0.04;                               ///< > 0
};

/// What is left of a severed spring's stiffness: enough to keep every vertex held.
inline constexpr double kSevered = 1e-4;

/// The object after the cut: springs that cross its sides are `severed` and have kSevered of their
/// stiffness, and triangles that do are gone. The rest shape stays, since springs pull with nothing
/// there. Throws Error for an object that dead loads keep in its shape (pre-strain, gravity): cut,
/// it would have another one.
SpringMesh with_cut(const SpringMesh& mesh, const ColumnCut& cut);

}  // namespace forcegrid::simulator
