// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "simulator/mesh/fineness.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::simulator {

/// Something to touch, read from a TOML file; docs/scenes.md describes every key.
struct Scene {
  std::string name;               ///< as requested: a scene's name, or a file
  std::string description;        ///< in one line
  double patch_radius_m = 0.012;  ///< the tool holds the vertices this near; > 0
  /// What a user has to know, such as where its force is not a function of the position alone.
  std::string note;
  std::vector<std::string> warnings;  ///< about legal but improbable values
  ToolOptions tool;                   ///< the tool that the scene is made for
  SpringMesh mesh;                    ///< of all objects together
};

/// Names that make_scene finds without a path, sorted.
std::vector<std::string> scene_names();

/// Empty if make_scene() finds the name `name_or_file`, or if it is a path; otherwise what is wrong
/// and what to write.
std::string scene_name_problem(const std::string& name_or_file);

/// Reads, generates and checks a scene.
/// @param name_or_file  a file name with a slash or ending in ".toml", or a scene's name, looked up
///        in $FORCEGRID_SCENE_PATH (if set), then beside the installed program, then in the source
///        tree.
/// @param origin_W  [m] where the scene's origin lies in W: the point that the tool of charts and
///        tests touches from above, on the first object's top.
/// Throws Error naming file, line and key; for an unknown name, the known names.
Scene make_scene(const std::string& name_or_file,
                 const Eigen::Vector3d& origin_W = Eigen::Vector3d::Zero());

/// The mesh of the same objects with fewer vertices, their springs and materials as written. Masses
/// are left out: it is for equilibria.
/// @param fineness  not kAsWritten.
/// Throws Error as make_scene(), for a scene under gravity, and for an object that has no such form
/// (Fineness).
SpringMesh make_coarser_mesh(const std::string& name_or_file,
                             const Eigen::Vector3d& origin_W = Eigen::Vector3d::Zero(),
                             Fineness fineness = Fineness::kHalf);

/// Reads Scene::tool alone, without making the objects. Throws as make_scene() does for what it
/// reads.
ToolOptions scene_tool(const std::string& name_or_file);

/// Throws Error if the scene's own tool slides or turns: `purpose` needs a force that is a function
/// of the position alone.
void refuse_sliding_tool(const std::string& scene, const ToolOptions& tool,
                         const std::string& purpose);

}  // namespace forcegrid::simulator
