// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace forcegrid::evaluation {

/// A second object that the tool runs into while it holds the first: a plane or a ball, without
/// friction, fixed in the workspace.
///
///   F(d) = -(k1 phi + k2 phi^2) grad s,   phi = max(0, s), or e ln(1 + exp(s/e)) of a soft one
///   s(d) = n.(d - a), or of a ball  R - |d - a - R n|
///
/// with the displacement d = P - P_contact from the place of the first contact, s the depth in the
/// wall. Conservative. Source: the method study, whose second contacts these are.
/// Threads: const.
struct Wall {
  Eigen::Vector3d normal_W = Eigen::Vector3d::UnitZ();  ///< n, a unit vector, into the wall
  Eigen::Vector3d surface_W_m{0.0, 0.0, 0.014};         ///< a, a displacement on the surface
  double radius_m = 0.0;                                ///< R; 0: a plane
  double stiffness_N_per_m = 1000.0;                    ///< k1
  double stiffening_N_per_m2 = 0.0;                     ///< k2
  double softness_m = 0.0;                              ///< e

  double depth_m(const Eigen::Vector3d& displacement_W) const noexcept;

  struct Value {
    Eigen::Vector3d force_W;      ///< [N]
    Eigen::Matrix3d stiffness_W;  ///< [N/m] dF/dd
  };
  Value at(const Eigen::Vector3d& displacement_W) const noexcept;
};

/// Walls that can be added to a scene of the chart.
struct NamedWalls {
  std::string name;
  std::string title;  ///< in a sentence's words, e.g. "a wall 14 mm up"
  std::vector<Wall> walls;
};

/// wall_flat (14 mm above the contact point, 1000 N/m), wall_tilted (by 25 degrees), wall_curved (a
/// ball of 20 mm), wall_stiffening (500 N/m and 1e5 N/m^2), wall_soft (e = 0.5 mm), wall_two (the
/// flat one, and 700 N/m 9 mm to the side).
const std::vector<NamedWalls>& named_walls();

}  // namespace forcegrid::evaluation
