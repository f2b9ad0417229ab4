// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

/// Makes the contact of a tool with an object under the chosen solver, for `rate_Hz` answers per
/// second. Remarks of a reduced model go to the log.
/// Throws Error as the solver's own contact does.
std::unique_ptr<ToolContact> make_solver_contact(const Scene& scene, const SolverChoice& solver,
                                                 const ToolOptions& tool, double rate_Hz);

}  // namespace forcegrid::simulator
