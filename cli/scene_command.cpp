// SPDX-License-Identifier: Apache-2.0
#include "cli/scene_command.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstdio>
#include <numeric>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/scene_option.h"
#include "cli/scene_force.h"
#include "simulator/mesh/scene.h"
#include "simulator/mesh/tetrahedra.h"
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

void print_elements(const simulator::SpringMesh& mesh) {
  if (mesh.tetrahedra.empty()) {
    return;
  }
  double least = 1.0;
  double sum = 0.0;
  for (const simulator::Tetrahedron& element : mesh.tetrahedra) {
    std::array<Eigen::Vector3d, 4> corner_m;
    for (std::size_t k = 0; k < 4; ++k) {
      corner_m[k] = unstrained_W(mesh)[static_cast<std::size_t>(element.vertex[k])];
    }
    const double quality = simulator::element_quality(corner_m);
    least = std::min(least, quality);
    sum += quality;
  }
  const std::vector<double> masses_kg = simulator::element_masses_kg(mesh);
  std::printf("  tetrahedra %zu, volume %.6g cm^3, mass %.6g kg\n", mesh.tetrahedra.size(),
              1e6 * simulator::element_volume_m3(mesh),
              std::accumulate(masses_kg.begin(), masses_kg.end(), 0.0));
  std::printf("  quality of the elements (1: regular): worst %.3f, mean %.3f\n", least,
              sum / static_cast<double>(mesh.tetrahedra.size()));
  for (const simulator::ElementMaterial& material : mesh.materials) {
    std::printf("  material: %s, E %.6g Pa, nu %.6g, %.6g kg/m^3\n",
                simulator::name_of(material.model), material.youngs_modulus_Pa,
                material.poissons_ratio, material.density_kg_per_m3);
  }
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
  print_elements(mesh);
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
  if (tool.turns) {
    std::printf(", turns with the hand");
  }
  std::printf("\n");
  if (!scene.note.empty()) {
    std::printf("  note: %s\n", scene.note.c_str());
  }
  for (const std::string& warning : scene.warnings) {
    std::printf("  warning: %s\n", warning.c_str());
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
  Option* const force_at =
      scene
          .add_option("--force-at", o.force_at_m,
                      "Take hold of the top, move the tool by x,y,z and print the converged force "
                      "of the object on it")
          ->separated_by(',')
          ->type_name("X,Y,Z m")
          ->not_in_config();
  scene
      .add_option("--contact", o.contact_m,
                  "With --force-at: where to take hold, in W (default: the scene's top)")
      ->separated_by(',')
      ->type_name("X,Y,Z m")
      ->needs(force_at)
      ->not_in_config();
  scene.add_flag("--json", o.json, "With --force-at: print the result as JSON")
      ->needs(force_at)
      ->not_in_config();
  scene
      .add_flag("--displacements", o.displacements,
                "With --force-at: add the displacement of every vertex")
      ->needs(force_at)
      ->not_in_config();
  scene.callback([&o, &action] { action = [&o] { return scene_command(o); }; });
}

int scene_command(const SceneOptions& options) {
  ProgressLine line;
  WorkProgress work(line);
  work.begin("Loading scene " + options.scene);
  const simulator::Scene scene = simulator::make_scene(options.scene);
  if (!options.force_at_m.empty()) {
    return print_force_at(scene, options, work);
  }
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
