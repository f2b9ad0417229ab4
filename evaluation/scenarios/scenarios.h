// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "evaluation/objects/force_table.h"
#include "evaluation/objects/object_effect.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::evaluation {

/// An object of the chart: a scene of the simulator at the trajectories' first contact point, with
/// a stiffness for which the trajectories need 2 to 3 N (RMS).
struct ChartScene {
  std::string name;
  std::string title;
  double stiffness_factor = 1.0;  ///< of every spring
  std::string object;             ///< as simulator::make_scene knows it
  SceneExtras extras;             ///< walls and object effects
  double patch_radius_m = 0.012;  ///< of the tool's grip
};

/// small_linear, small, block_linear, block: from the fastest to the hardest. A chart takes these
/// if none are selected.
const std::vector<ChartScene>& chart_scenes();

/// Each of them with each of named_walls() and named_object_effects(), e.g. small+wall_flat,
/// small+cut.
const std::vector<ChartScene>& hard_scenes();

/// Returns one of these, or any other scene of the simulator by name or TOML file, plain or with
/// one of those extras: stomach+wall_flat. Threads: any.
/// @throws ChartError for an unknown name, listing the known ones; simulator::Error for a file that
///         can't be used.
const ChartScene& chart_scene(const std::string& name);

/// A scene's name as part of the name of a file or folder: itself, or for one that is a path the
/// last part and eight digits that differ for another path: DIR/mine.toml+cut becomes
/// mine.toml+cut-0123abcd.
std::string file_name_part(const std::string& scene);

/// Makes the object's mesh with all spring stiffnesses times the scene's factor, which scales the
/// force equally.
simulator::SpringMesh make_mesh(const ChartScene& scene);

/// [m] Displacements at which a table is compared with the object itself: every `every_s` [s] along
/// the motion `random`, and uniformly random ones over the whole table.
std::vector<Eigen::Vector3d> displacements_along_motion(std::uint64_t seed, double every_s);
std::vector<Eigen::Vector3d> random_displacements(const TableLattice& lattice, std::uint64_t seed,
                                                  int count);

}  // namespace forcegrid::evaluation
