// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace forcegrid::simulator {

/// The state of the vertices around the tool, to exchange between two objects that hold the same
/// patch of the same mesh. Single precision.
struct Neighbourhood {
  struct Vertex {
    Eigen::Vector3f position_W = Eigen::Vector3f::Zero();     ///< [m] from the mesh's top
    Eigen::Matrix3f sensitivity_W = Eigen::Matrix3f::Zero();  ///< S: row c, column j is dx_c / dP_j
  };
  Eigen::Vector3d displacement_W = Eigen::Vector3d::Zero();  ///< [m] of the tool since the grab
  std::vector<Vertex> vertices;
};

}  // namespace forcegrid::simulator
