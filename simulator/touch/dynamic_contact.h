#pragma once

#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/solver/dynamic_object.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

/// A tool that sticks to an object which moves by itself (DynamicObject): touches and lets go as
/// StickyContact does, by the surface at rest. From one step to the next the object lives through
/// the time between their stamps (ToolContact::tell_time), also while nothing touches it; the tool
/// goes along the positions that were told between (ToolContact::was_at), smoothed as ToolPath
/// does, and touches where that way meets the surface. The answer is for the way's end, which is
/// some encoder counts at most beside the position of the step. Time that does not go on is none;
/// after a pause longer than DynamicOptions::max_steps steps the tool goes straight. Throws Error
/// for a scene without masses, a tool that slides, and options out of range.
std::unique_ptr<ToolContact> make_dynamic_contact(const Scene& scene, const DynamicOptions& solver,
                                                  const ToolOptions& options);

}  // namespace forcegrid::simulator
