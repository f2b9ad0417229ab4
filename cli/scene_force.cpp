// SPDX-License-Identifier: Apache-2.0
#include "cli/scene_force.h"

#include <Eigen/Core>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;

// The force's error is of second order in the residual, so this leaves rounding.
constexpr double kTolerance = 1e-9;
constexpr double kFloor_N = 1e-3;

Eigen::Vector3d vector_of(const std::vector<double>& numbers, const std::string& option) {
  if (numbers.size() != 3 || !std::isfinite(numbers[0]) || !std::isfinite(numbers[1]) ||
      !std::isfinite(numbers[2])) {
    throw simulator::Error(option + ": " + std::to_string(numbers.size()) +
                           " numbers; write three finite ones in metres, x,y,z without spaces");
  }
  return {numbers[0], numbers[1], numbers[2]};
}

simulator::SolverOptions precise() {
  simulator::SolverOptions options;
  options.relative_tolerance = kTolerance;
  options.force_floor_N = kFloor_N;
  options.sensitivity_tolerance = 1e-4;
  options.max_steps = 1000;
  options.max_iterations = 20000;
  options.max_recovery_steps = 200;
  return options;
}

ordered_json triple(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

int print_force_at(const simulator::Scene& scene, const SceneOptions& options, WorkProgress& work) {
  const Eigen::Vector3d displacement_W = vector_of(options.force_at_m, "--force-at");
  const Eigen::Vector3d contact_W =
      options.contact_m.empty() ? scene.mesh.top_W : vector_of(options.contact_m, "--contact");
  work.begin("Solving scene " + scene.name);
  simulator::ElasticObject<double> object(scene.mesh, precise());
  const int held = object.grab(contact_W, scene.patch_radius_m);
  if (held == 0) {
    throw simulator::Error(
        "--contact: no vertex that can move lies within the scene's "
        "patch_radius_m, " +
        std::to_string(scene.patch_radius_m) + " m, of it; name a place on the object, in W");
  }
  const simulator::Equilibrium found = object.move_to(displacement_W);
  work.end();
  if (options.json) {
    ordered_json json = {{"scene", scene.name},
                         {"contact_m", triple(contact_W)},
                         {"patch_radius_m", scene.patch_radius_m},
                         {"patch_vertices", held},
                         {"displacement_m", triple(found.displacement_W)},
                         {"force_N", triple(found.force_W)},
                         {"stiffness_N_per_m", ordered_json::array()},
                         {"relative_residual", found.relative_residual},
                         {"left_branch", found.left_branch},
                         {"converged", found.converged && found.reached}};
    for (int row = 0; row < 3; ++row) {
      json["stiffness_N_per_m"].push_back(triple(found.stiffness_W.row(row)));
    }
    if (options.displacements) {
      ordered_json& all = json["displacements_m"] = ordered_json::array();
      const std::vector<Eigen::Vector3d> positions_W = object.positions_W();
      for (std::size_t i = 0; i < positions_W.size(); ++i) {
        all.push_back(triple(positions_W[i] - scene.mesh.rest_position_W[i]));
      }
    }
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    std::printf(
        "force on the tool along x, y, z: %.9g, %.9g, %.9g N (%d vertices held, residual "
        "%.1e of it)\n",
        found.force_W.x(), found.force_W.y(), found.force_W.z(), held, found.relative_residual);
    if (options.displacements) {
      const std::vector<Eigen::Vector3d> positions_W = object.positions_W();
      for (std::size_t i = 0; i < positions_W.size(); ++i) {
        const Eigen::Vector3d by_W = positions_W[i] - scene.mesh.rest_position_W[i];
        std::printf("vertex %zu: %.9g, %.9g, %.9g m\n", i + 1, by_W.x(), by_W.y(), by_W.z());
      }
    }
  }
  for (const std::string& warning : scene.warnings) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  if (!found.converged || !found.reached) {
    std::fprintf(stderr,
                 "no equilibrium found there: a residual of %.1e of the force is left, at %.4g, "
                 "%.4g, %.4g m; move less far\n",
                 found.relative_residual, found.displacement_W.x(), found.displacement_W.y(),
                 found.displacement_W.z());
    return 1;
  }
  return 0;
}

}  // namespace forcegrid::cli
