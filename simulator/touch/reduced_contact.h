// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/solver/reduced_object.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

/// Makes the contact of a tool that sticks to a ReducedObject, which learns a reduced model during
/// the grab.
/// Throws Error for a tool that slides, and options out of range.
std::unique_ptr<ToolContact> make_reduced_contact(const Scene& scene,
                                                  const ReducedObjectOptions& solver,
                                                  const ToolOptions& options);

}  // namespace forcegrid::simulator
