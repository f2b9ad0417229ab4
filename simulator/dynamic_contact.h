#pragma once

#include <memory>

#include "simulator/dynamic_object.h"
#include "simulator/scene.h"
#include "simulator/tool_contact.h"

namespace forcegrid::simulator {

/// A tool that sticks to an object which moves by itself (DynamicObject): touches and lets go as
/// StickyContact does, by the surface at rest. Between two positions the object lives through the
/// time between their stamps (ToolContact::tell_time), also while nothing touches it; the tool goes
/// straight from one to the other. Time that does not go on is none.
/// Throws Error for a scene without masses, a tool that slides, and options out of range.
std::unique_ptr<ToolContact> make_dynamic_contact(const Scene& scene, const DynamicOptions& solver,
                                                  const ToolOptions& options);

}  // namespace forcegrid::simulator
