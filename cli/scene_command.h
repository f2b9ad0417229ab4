// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/common/options.h"

namespace forcegrid::cli {

struct SceneOptions {
  std::string scene;
  bool return_test = false;
  std::vector<double> force_at_m;  ///< empty, or the tool's displacement along x, y, z
  std::vector<double> contact_m;   ///< empty, or where it takes hold
  bool json = false;               ///< print the force as JSON
  bool displacements = false;
};

/// Adds `forcegrid scene`, which sets `action`.
void add_scene(Command& app, SceneOptions& options, std::function<int()>& action);

/// Prints a description of a scene and, with return_test, how far its force is from a function of
/// position; with force_at_m, the converged force of a tool that was moved there instead.
/// @returns the program's exit status: 0, or 1 if no equilibrium was found at force_at_m.
int scene_command(const SceneOptions& options);

}  // namespace forcegrid::cli
