// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/scenarios.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>

#include "evaluation/motions/trajectories.h"
#include "simulator/mesh/scene.h"
#include "text/text.h"

namespace forcegrid::evaluation {

const std::vector<ChartScene>& chart_scenes() {
  static const std::vector<ChartScene> all{
      {"small_linear", "1,089 vertices, 8,268 linear springs", 1.2, "small_linear", {}},
      {"small", "1,089 vertices, 8,268 hardening springs", 1.0, "small", {}},
      {"block_linear", "10,164 vertices, 84,566 linear springs", 1.2, "block_linear", {}},
      {"block", "10,164 vertices, 84,566 hardening springs", 1.0, "block", {}}};
  return all;
}

const std::vector<ChartScene>& hard_scenes() {
  static const std::vector<ChartScene> all = [] {
    std::vector<ChartScene> scenes;
    for (const ChartScene& scene : chart_scenes()) {
      const auto add = [&](const std::string& name, const std::string& title, SceneExtras extras) {
        scenes.push_back({scene.name + '+' + name, scene.title + ", and " + title,
                          scene.stiffness_factor, scene.object, std::move(extras),
                          scene.patch_radius_m});
      };
      for (const NamedWalls& each : named_walls()) {
        add(each.name, each.title, {each.walls, {}});
      }
      for (const NamedObjectEffect& each : named_object_effects()) {
        add(each.name, each.title, {{}, each.effect});
      }
    }
    return scenes;
  }();
  return all;
}

namespace {

// Any other scene of the simulator, with or without extras, kept for as long as the program runs.
const ChartScene* other_scene(const std::string& name) {
  static std::mutex mutex;
  static std::map<std::string, ChartScene> all;
  const std::lock_guard lock(mutex);
  if (const auto found = all.find(name); found != all.end()) {
    return &found->second;
  }
  const std::size_t plus = std::min(name.rfind('+'), name.size());
  const std::string object = name.substr(0, plus);
  SceneExtras extras;
  std::string extra_title;
  if (plus < name.size()) {
    for (const NamedWalls& each : named_walls()) {
      if (each.name == name.substr(plus + 1)) {
        extras.walls = each.walls;
        extra_title = ", and " + each.title;
      }
    }
    for (const NamedObjectEffect& each : named_object_effects()) {
      if (each.name == name.substr(plus + 1)) {
        extras.effect = each.effect;
        extra_title = ", and " + each.title;
      }
    }
  }
  if ((plus < name.size() && extra_title.empty()) ||
      !simulator::scene_name_problem(object).empty()) {
    return nullptr;
  }
  const simulator::Scene scene = simulator::make_scene(object);
  simulator::refuse_sliding_tool(object, scene.tool, "a chart");
  return &all.emplace(name, ChartScene{name, scene.description + extra_title, 1.0, object,
                                       std::move(extras), scene.patch_radius_m})
              .first->second;
}

}  // namespace

const ChartScene& chart_scene(const std::string& name) {
  std::string known;
  for (const auto* scenes : {&chart_scenes(), &hard_scenes()}) {
    for (const ChartScene& scene : *scenes) {
      if (scene.name == name) {
        return scene;
      }
      known += (known.empty() ? "" : ", ") + scene.name;
    }
  }
  if (const ChartScene* scene = other_scene(name); scene != nullptr) {
    return *scene;
  }
  throw ChartError("scene '" + name + "' is not in the chart; known scenes: " + known +
                   "; or write another scene of 'forcegrid simulate' or a TOML file: " +
                   text::joined(simulator::scene_names()));
}

std::string file_name_part(const std::string& scene) {
  const std::size_t slash = scene.rfind('/');
  if (slash == std::string::npos) {
    return scene;
  }
  constexpr std::size_t kDigits = 8;
  ContentHash hash;
  hash.add(scene);
  return scene.substr(slash + 1) + '-' + hash.text().substr(0, kDigits);
}

simulator::SpringMesh make_mesh(const ChartScene& scene) {
  simulator::SpringMesh mesh = simulator::make_scene(scene.object, first_contact_point_W()).mesh;
  simulator::scale_forces(mesh, scene.stiffness_factor);
  return mesh;
}

std::vector<Eigen::Vector3d> displacements_along_motion(std::uint64_t seed, double every_s) {
  const Trajectory motion("random", seed);
  std::vector<Eigen::Vector3d> displacements_W;
  for (double time_s = 0.0; time_s < motion.duration_s(); time_s += every_s) {
    displacements_W.push_back(motion.position_W(time_s) - first_contact_point_W());
  }
  return displacements_W;
}

std::vector<Eigen::Vector3d> random_displacements(const TableLattice& lattice, std::uint64_t seed,
                                                  int count) {
  SeededNumbers numbers(seed);
  const Eigen::Vector3d max_W_m = lattice.max_W_m();
  std::vector<Eigen::Vector3d> displacements_W;
  for (int i = 0; i < count; ++i) {
    Eigen::Vector3d displacement_W;
    for (int axis = 0; axis < 3; ++axis) {
      displacement_W[axis] = numbers.uniform(lattice.min_W_m[axis], max_W_m[axis]);
    }
    displacements_W.push_back(displacement_W);
  }
  return displacements_W;
}

}  // namespace forcegrid::evaluation
