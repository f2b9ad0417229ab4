#pragma once

#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/solver/reduced_object.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

/// A tool that sticks to an object which learns a reduced model of itself as the grab lasts
/// (ReducedObject).
/// Throws Error for a tool that slides, and options out of range.
std::unique_ptr<ToolContact> make_reduced_contact(const Scene& scene,
                                                  const ReducedObjectOptions& solver,
                                                  const ToolOptions& options);

}  // namespace forcegrid::simulator
