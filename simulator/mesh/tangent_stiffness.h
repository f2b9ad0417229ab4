// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// [N/m] How the force of a spring on its first end changes with the place of its second one:
///
///   H = (f' - f/l) u u^T + f/l I     with l = |d|, u = d / l, f as SpringLaw has it
///
/// @param d_m  from end `a` to end `b` in W, longer than zero.
Eigen::Matrix3d spring_stiffness_W(const SpringMesh& mesh, const Spring& spring,
                                   const Eigen::Vector3d& d_m);

/// The coordinates of a mesh's free vertices as one vector: x, y, z of each, in the mesh's order.
struct FreeCoordinates {
  /// Of a mesh whose vertices are free unless SpringMesh::fixed has them.
  explicit FreeCoordinates(const SpringMesh& mesh);

  std::vector<Eigen::Index> first;  ///< one per vertex: its x among them; -1: fixed
  Eigen::Index count = 0;           ///< three per free vertex
};

/// [N/m] K = -dr/dx: r the forces on the free vertices, x their coordinates, at `position_W` [m].
/// Springs, elements and home springs; loads have no derivative. Symmetric, both triangles filled.
Eigen::SparseMatrix<double> tangent_stiffness_W(const SpringMesh& mesh,
                                                const FreeCoordinates& coordinates,
                                                const std::vector<Eigen::Vector3d>& position_W);

}  // namespace forcegrid::simulator
