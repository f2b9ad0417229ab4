#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "profiles/toml_table.h"
#include "simulator/spring_mesh.h"

namespace forcegrid::simulator {

/// Keys that a table [[object]] may have, by its `shape`.
/// @throws profiles::TomlError for a missing or unknown shape.
std::vector<std::string> scene_object_keys(const profiles::TomlTable& object);

/// The mesh that a table [[object]] describes.
/// @param origin_W  [m] the scene's origin.
/// @throws profiles::TomlError naming file, line and key; Error for a mesh that can't be.
SpringMesh make_scene_object(const profiles::TomlTable& object, const Eigen::Vector3d& origin_W);

}  // namespace forcegrid::simulator
