// SPDX-License-Identifier: Apache-2.0
#include "cli/scene_command.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>

#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/scene_option.h"
#include "simulator/mesh/scene.h"
#include "simulator/reference/return_test.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::cli {
namespace {

// What has to be solved for.
struct SceneFacts {
  int held = 0;
  Eigen::Matrix3d stiffness_W_N_per_m = Eigen::Matrix3d::Zero();
};

SceneFacts facts_of(const simulator::Scene& scene) {
  simulator::ElasticObject<double> object(scene.mesh);
  SceneFacts facts;
  facts.held = object.grab(scene.mesh.top_W, scene.patch_radius_m);
  facts.stiffness_W_N_per_m = object.move_to(Eigen::Vector3d::Zero()).stiffness_W;
  return facts;
}

void print_facts(const simulator::Scene& scene, const SceneFacts& facts) {
  const simulator::SpringMesh& mesh = scene.mesh;
  Eigen::Array3d low_m = mesh.rest_position_W.front().array();
  Eigen::Array3d high_m = low_m;
  for (const Eigen::Vector3d& position_W : mesh.rest_position_W) {
    low_m = low_m.min(position_W.array());
    high_m = high_m.max(position_W.array());
  }
  const Eigen::Array3d size_mm = 1e3 * (high_m - low_m);
  std::printf("%s: %s\n", scene.name.c_str(), scene.description.c_str());
  std::printf("  vertices %zu (%td fixed), springs %zu, triangles of the surface %zu\n",
              mesh.rest_position_W.size(), std::count(mesh.fixed.begin(), mesh.fixed.end(), 1),
              mesh.springs.size(), mesh.triangles.size());
  std::printf("  size along x, y, z: %.1f, %.1f, %.1f mm\n", size_mm.x(), size_mm.y(), size_mm.z());
  std::printf(
      "  a tool at the top holds %d vertices within %.1f mm and feels a stiffness of\n"
      "  %.1f, %.1f, %.1f N/m along x, y, z\n",
      facts.held, 1e3 * scene.patch_radius_m, -facts.stiffness_W_N_per_m(0, 0),
      -facts.stiffness_W_N_per_m(1, 1), -facts.stiffness_W_N_per_m(2, 2));
  const simulator::ToolOptions& tool = scene.tool;
  std::printf("  its tool: %s, contact %s", tool.shape.c_str(), tool.contact.c_str());
  if (tool.shape != "point") {
    std::printf(", radius %.1f mm", 1e3 * tool.radius_m);
  }
  if (tool.slides()) {
    std::printf(", friction %.2f", tool.friction);
  }
  std::printf("\n");
  if (!scene.note.empty()) {
    std::printf("  note: %s\n", scene.note.c_str());
  }
}

void print_return_test(const simulator::Scene& scene, ProgressLine& line) {
  std::printf(
      "Return test, 40 steps out and 40 back over the same positions:\n"
      "  %-22s %14s %14s %8s\n",
      "path", "hysteresis", "largest force", "of it");
  std::fflush(stdout);
  std::string multivalued;
  const std::vector<simulator::ReturnPath>& paths = simulator::return_paths();
  for (std::size_t i = 0; i < paths.size(); ++i) {
    line.show("Return test", static_cast<double>(i) / static_cast<double>(paths.size()));
    const simulator::ReturnResult result = simulator::return_test(scene, paths[i]);
    line.pause();
    std::printf("  %-22s %12.2e N %12.3f N %6.4f %%%s\n", result.name.c_str(), result.hysteresis_N,
                result.largest_force_N, 100.0 * result.hysteresis_N / result.largest_force_N,
                result.unconverged > 0 ? "  (not converged everywhere)" : "");
    std::fflush(stdout);
    if (!simulator::single_valued(result)) {
      multivalued += (multivalued.empty() ? "" : ", ") + result.name;
    }
  }
  line.clear();
  if (multivalued.empty()) {
    std::printf("On all of them the force is a function of position.\n");
  } else {
    std::printf(
        "The force is not a function of position on: %s.\nNo method can be correct in both "
        "directions there. Increase pre_strain or home_stiffness_N_per_m, or describe it in the "
        "scene's note.\n",
        multivalued.c_str());
  }
}

}  // namespace

void add_scene(Command& app, SceneOptions& o, std::function<int()>& action) {
  Command& scene = app.add_subcommand("scene", "Describe a scene; see docs/scenes.md");
  scene.add_option("SCENE", o.scene, scene_help())->required()->check(scene_check());
  scene.add_flag("--return-test", o.return_test,
                 "Pull, shear and push its top out and back, and print how much the force differs");
  scene.callback([&o, &action] { action = [&o] { return scene_command(o); }; });
}

int scene_command(const SceneOptions& options) {
  ProgressLine line;
  WorkProgress work(line);
  work.begin("Loading scene " + options.scene);
  const simulator::Scene scene = simulator::make_scene(options.scene);
  work.begin("Solving scene " + options.scene + " at rest");
  const SceneFacts facts = facts_of(scene);
  work.end();
  print_facts(scene, facts);
  if (options.return_test) {
    print_return_test(scene, line);
  }
  return 0;
}

}  // namespace forcegrid::cli
