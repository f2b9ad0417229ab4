// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/common/progress_line.h"
#include "cli/scene_command.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::cli {

/// `forcegrid scene --force-at`: takes hold of the scene at SceneOptions::contact_m, moves the tool
/// by force_at_m in double precision to a residual of 1e-9 of the force, and prints the force of
/// the object on the tool.
/// Throws Error for a displacement or a place that is not three finite numbers, and for a place
/// with nothing to hold.
/// @returns 0, or 1 with a message if the solver did not converge there.
int print_force_at(const simulator::Scene& scene, const SceneOptions& options, WorkProgress& work);

}  // namespace forcegrid::cli
