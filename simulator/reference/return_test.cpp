// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/return_test.h"

#include <algorithm>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {
namespace {

constexpr double kRelativeTolerance = 1e-7;
constexpr double kMultivalued = 1e-4;  // of the largest force

}  // namespace

bool single_valued(const ReturnResult& result) noexcept {
  return result.unconverged == 0 && result.hysteresis_N <= kMultivalued * result.largest_force_N;
}

const std::vector<ReturnPath>& return_paths() {
  static const std::vector<ReturnPath> paths{{"pull 20 mm", {0.0, 0.0, 0.020}},
                                             {"shear 20 mm along x", {0.020, 0.0, 0.0}},
                                             {"shear 20 mm along y", {0.0, 0.020, 0.0}},
                                             {"push 5 mm", {0.0, 0.0, -0.005}},
                                             {"push 10 mm", {0.0, 0.0, -0.010}}};
  return paths;
}

ReturnResult return_test(const Scene& scene, const ReturnPath& path, int steps) {
  if (steps < 1) {
    throw Error("return test: " + std::to_string(steps) + " steps; give at least one");
  }
  SolverOptions options;
  options.relative_tolerance = kRelativeTolerance;
  ElasticObject<double> object(scene.mesh, options);
  if (object.grab(scene.mesh.top_W, scene.patch_radius_m) == 0) {
    throw Error("return test: no free vertex within " + std::to_string(scene.patch_radius_m) +
                " m of the top of scene " + scene.name + "; use a larger patch_radius_m");
  }
  ReturnResult result{.name = path.name};
  std::size_t done = 0;
  const auto force_at = [&](int step) -> Eigen::Vector3d {
    rt::checkpoint(done++, 2 * static_cast<std::size_t>(steps) + 1);
    const Equilibrium equilibrium =
        object.move_to(path.displacement_W * (static_cast<double>(step) / steps));
    result.unconverged += equilibrium.converged && equilibrium.reached ? 0 : 1;
    result.branch_changes += equilibrium.left_branch ? 1 : 0;
    result.largest_force_N = std::max(result.largest_force_N, equilibrium.force_W.norm());
    return equilibrium.force_W;
  };
  std::vector<Eigen::Vector3d> out_W;
  for (int step = 0; step <= steps; ++step) {
    out_W.push_back(force_at(step));
  }
  for (int step = steps - 1; step >= 0; --step) {
    const double difference_N = (force_at(step) - out_W[static_cast<std::size_t>(step)]).norm();
    result.hysteresis_N = std::max(result.hysteresis_N, difference_N);
  }
  return result;
}

}  // namespace forcegrid::simulator
