// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/reference/reference_solution.h"

namespace forcegrid::simulator {

/// The reference force of a dynamic object (DynamicObject): the force at every position of the
/// recorded path on a tool that grabbed the object at its first contact.
///
/// Time steps are at most 0.5 ms, so that the method adds a retardation time of at most 0.5 ms;
/// each is solved to options.relative_tolerance. Dampers would react to the encoder steps of the
/// path, so each position is the mean of up to five cycles, two before to two after. The tool moves
/// straight from the contact point to the first position, at the speed of the first five cycles, in
/// at least one cycle and at most 0.1 s.
///
/// @param times_s  [s] of each of `positions_W` [m]; increasing.
/// @param options  contact_point_W, first_contact_cycle, relative_tolerance, progress and cancel
///   are used; the others are for equilibria.
/// Throws Error for a scene without masses, times that do not rise, a position that is not finite,
/// a first cycle beyond the path, or a contact point without a vertex to hold.
/// Threads: only the calling one, since every position depends on those before.
ReferenceSolution simulate_dynamic_reference(const Scene& scene,
                                             const std::vector<Eigen::Vector3d>& positions_W,
                                             const std::vector<double>& times_s,
                                             const ReferenceOptions& options);

}  // namespace forcegrid::simulator
