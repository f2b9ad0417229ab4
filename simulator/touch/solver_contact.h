#pragma once

#include <iosfwd>
#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

/// How a tool meets an object that the chosen solver solves, `rate_Hz` times a second. What a
/// reduced model's use changes goes to `log`, which must live as long.
/// Throws Error as the solver's own contact does.
std::unique_ptr<ToolContact> make_solver_contact(const Scene& scene, const SolverChoice& solver,
                                                 const ToolOptions& tool, double rate_Hz,
                                                 std::ostream& log);

}  // namespace forcegrid::simulator
