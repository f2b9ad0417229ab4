// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/mesh/vertex_masses.h"
#include "text/toml_table.h"

namespace forcegrid::simulator {

/// Keys that a table [[object]] may have, by its `shape`.
/// @throws text::TomlError for a missing or unknown shape.
std::vector<std::string> scene_object_keys(const text::TomlTable& object);

/// How finely an object is made.
enum class Fineness {
  kAsWritten,
  /// About half the vertices per axis: (n + 1) / 2 of a block, a quarter of the vertices and edges
  /// of an organ, at least its fewest. An organ's home springs carry the same area with fewer
  /// vertices. Not for an object of a mesh file.
  kHalf
};

/// The mesh that a table [[object]] describes.
/// @param origin_W  [m] the scene's origin.
/// @throws text::TomlError naming file, line and key; Error for an impossible mesh.
SpringMesh make_scene_object(const text::TomlTable& object, const Eigen::Vector3d& origin_W,
                             Fineness fineness = Fineness::kAsWritten);

/// What is legal in the table's materials but belongs to no tissue: one text per value, with file,
/// line and key. The same errors as make_scene_object().
std::vector<std::string> material_warnings(const text::TomlTable& object);

/// Mass and damping of a table [[object]] and its mesh; nothing if it has neither a mass_kg nor
/// elements, whose density gives the mass.
/// @throws text::TomlError naming file, line and key, also for damping without a mass.
std::optional<ObjectDynamics> read_dynamics(const text::TomlTable& object, const SpringMesh& mesh);

}  // namespace forcegrid::simulator
