#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "simulator/reference/reference_solution.h"

namespace forcegrid::cli {

/// Whether the scene is solved as an object that moves by itself: what --solver asks for, and for
/// auto what the scene has.
/// Throws simulator::Error for an unknown scene.
bool moves_by_itself(const std::string& scene, const std::string& solver);

/// The reference forces along a recorded path of a tool that sticks: of the object in motion where
/// moves_by_itself(), else of its equilibria.
/// @param times_s  of `positions_W` [m], on any clock.
/// @param options  scene included.
simulator::ReferenceSolution solve_reference_forces(const std::string& solver,
                                                    const std::vector<Eigen::Vector3d>& positions_W,
                                                    const std::vector<double>& times_s,
                                                    const simulator::ReferenceOptions& options);

}  // namespace forcegrid::cli
