// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {

/// A straight move of a tool that holds the top, and back.
struct ReturnPath {
  std::string name;
  Eigen::Vector3d displacement_W = Eigen::Vector3d::Zero();  ///< [m] at its far end
};

/// The result. Where force is a function of the tool's position alone, the solver's tolerance is
/// the only cause of hysteresis.
struct ReturnResult {
  std::string name;
  double hysteresis_N = 0.0;       ///< largest |F| difference between out and back at one position
  double largest_force_N = 0.0;    ///< of |F| on the way
  std::size_t unconverged = 0;     ///< positions whose tolerance was not reached
  std::size_t branch_changes = 0;  ///< positions at which the object changed to another branch
};

/// Whether force was a function of position on the way: the hysteresis is below 1e-4 of the largest
/// force (the tolerance alone leaves less than 1e-6 of it), and every position was solved.
bool single_valued(const ReturnResult& result) noexcept;

/// Pull by 20 mm, shear by 20 mm along x and y, push by 5 and 10 mm.
const std::vector<ReturnPath>& return_paths();

/// Grabs the scene's top, moves out in `steps` equal steps and back over the same positions, in
/// double precision to a relative residual of 1e-7, and compares the forces. Source of the paths
/// and of the comparison: the solver study.
/// Throws Error when no vertex is near the top, or steps < 1.
ReturnResult return_test(const Scene& scene, const ReturnPath& path, int steps = 40);

}  // namespace forcegrid::simulator
