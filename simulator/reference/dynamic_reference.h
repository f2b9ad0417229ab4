#pragma once

#include <Eigen/Core>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/reference/reference_solution.h"

namespace forcegrid::simulator {

/// The reference force of an object that moves by itself: what a tool that went along the recorded
/// path, and grabbed at its first contact, would have felt at every position (DynamicObject). Time
/// steps of at most 0.5 ms, so that the method's own damping is a retardation time of 0.5 ms; each
/// solved to options.relative_tolerance. The path is known in encoder counts, whose jumps a damper
/// would feel: it is taken as the mean of up to five cycles around each, two before to two after.
/// The tool has come from the contact point to the first position straight, at the speed of the
/// first five cycles, in a cycle at least and in 0.1 s at most.
///
/// @param times_s  when the tool was at each of `positions_W` [m]; rising.
/// @param options  of the path: contact_point_W, first_contact_cycle; of the solver:
///   relative_tolerance; progress and cancel. The rest is for equilibria.
/// Throws Error for a scene without masses, times that do not rise, a position that is not finite,
/// a first cycle beyond the path, or a contact point without a vertex to hold.
/// Threads: the calling one alone, as every position depends on those before.
ReferenceSolution simulate_dynamic_reference(const Scene& scene,
                                             const std::vector<Eigen::Vector3d>& positions_W,
                                             const std::vector<double>& times_s,
                                             const ReferenceOptions& options);

}  // namespace forcegrid::simulator
