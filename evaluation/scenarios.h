#pragma once

#include <string>
#include <vector>

#include "evaluation/force_table.h"
#include "evaluation/object_effect.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::evaluation {

/// An object of the chart: a scene of the simulator, as stiff as lets the trajectories need 2 to
/// 3 N (RMS), at the trajectories' first contact point.
struct ChartScene {
  std::string name;
  std::string title;
  double stiffness_factor = 1.0;  ///< of every spring
  std::string object;             ///< as simulator::make_scene knows it
  SceneExtras extras;             ///< walls, or what its table does not show
  double patch_radius_m = 0.012;  ///< of the tool's grip
};

/// small_linear, small, block_linear, block: from the quickest to the hardest. What a chart takes
/// when nothing is selected.
const std::vector<ChartScene>& chart_scenes();

/// Each of them with each of named_walls() and named_object_effects(), e.g. small+wall_flat,
/// small+cut.
const std::vector<ChartScene>& hard_scenes();

/// One of either, or any other scene of the simulator by name or TOML file, as it is or with one of
/// those extras: stomach+wall_flat. Threads: any.
/// @throws ChartError for an unknown name, listing the known ones; simulator::Error for a file that
///         can't be used.
const ChartScene& chart_scene(const std::string& name);

/// The object's mesh, its springs made stiffer by the scene's factor (the force scales alike).
simulator::SpringMesh make_mesh(const ChartScene& scene);

/// Displacements at which a table is compared with the object itself: along the motion `random`
/// every `every_s` seconds, and uniformly random ones over the whole table.
std::vector<Eigen::Vector3d> displacements_along_motion(std::uint64_t seed, double every_s);
std::vector<Eigen::Vector3d> random_displacements(const TableLattice& lattice, std::uint64_t seed,
                                                  int count);

}  // namespace forcegrid::evaluation
