// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "simulator/reference/reference_solution.h"

namespace forcegrid::cli {

/// Whether the scene is solved as an object that moves by itself: as --solver requests, or for
/// `auto` as the scene defines. @throws simulator::Error for an unknown scene.
bool moves_by_itself(const std::string& scene, const std::string& solver);

/// Computes the reference forces along the recorded path of a tool in sticky contact: of the moving
/// object if moves_by_itself(), otherwise of its equilibria.
/// @param times_s [s] of `positions_W` [m], on any clock.
/// @param options  scene included.
simulator::ReferenceSolution solve_reference_forces(const std::string& solver,
                                                    const std::vector<Eigen::Vector3d>& positions_W,
                                                    const std::vector<double>& times_s,
                                                    const simulator::ReferenceOptions& options);

}  // namespace forcegrid::cli
