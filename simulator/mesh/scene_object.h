// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "simulator/mesh/fineness.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/mesh/vertex_masses.h"
#include "text/toml_table.h"

namespace forcegrid::simulator {

/// Keys that a table [[object]] may have, by its `shape`.
/// @throws text::TomlError for a missing or unknown shape.
std::vector<std::string> scene_object_keys(const text::TomlTable& object);

/// The mesh that a table [[object]] describes.
/// @param origin_W  [m] the scene's origin.
/// @throws text::TomlError naming file, line and key; Error for an impossible mesh, and where Gmsh
/// makes no coarser one.
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
