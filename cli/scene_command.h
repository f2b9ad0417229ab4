// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "cli/common/options.h"

namespace forcegrid::cli {

struct SceneOptions {
  std::string scene;
  bool return_test = false;
};

/// Adds `forcegrid scene`, which sets `action`.
void add_scene(Command& app, SceneOptions& options, std::function<int()>& action);

/// Prints a description of a scene and, with return_test, how far its force is from a function of
/// position.
/// @returns the program's exit status, 0.
int scene_command(const SceneOptions& options);

}  // namespace forcegrid::cli
