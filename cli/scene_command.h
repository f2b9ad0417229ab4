#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

namespace forcegrid::cli {

struct SceneOptions {
  std::string scene;
  bool return_test = false;
};

/// Adds `forcegrid scene`, which sets `action`.
void add_scene(CLI::App& app, SceneOptions& options, std::function<int()>& action);

/// Prints what a scene is made of and, asked for, how single-valued its force is.
int scene_command(const SceneOptions& options);

}  // namespace forcegrid::cli
