// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/solver/dynamic_object.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

/// Makes the contact of a tool that sticks to a DynamicObject. It touches and lets go as
/// StickyContact does, by the surface at rest.
///
/// Each step advances the object by the time since the last one (ToolContact::tell_time), also
/// without contact. In between the tool follows the positions of ToolContact::was_at, smoothed by
/// ToolPath, and touches where that path crosses the surface. The answer belongs to the end of the
/// path, which is at most a few encoder counts from the position of the step. A time that does not
/// increase counts as 0 s. After a pause longer than DynamicOptions::max_steps steps the tool moves
/// straight to its new position.
/// Throws Error for a scene without masses, a tool that slides, and options out of range.
std::unique_ptr<ToolContact> make_dynamic_contact(const Scene& scene, const DynamicOptions& solver,
                                                  const ToolOptions& options);

}  // namespace forcegrid::simulator
