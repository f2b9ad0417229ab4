// SPDX-License-Identifier: Apache-2.0
// One end of bench/getfem_peer.py: this project's solver along the motion of forcegrid simulate
// --bench at 30 Hz.
//
//   forcegrid_solver_steps SCENE SECONDS TOLERANCE...
//
// First line: the numbers of vertices, elements and ticks, Young's modulus [Pa] and Poisson's ratio
// of the first material. A vertex' line: where it is at rest [m], and 0 free, 1 fixed or 2 held by
// the tool. An element's line: its vertices, from 0. A tick's line: displacement of the tool since
// it took hold of the top [m], converged force on it [N], and for each tolerance (of the relative
// residual) the force [N] and the solver's processor time [ms].

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include "evaluation/scenarios/scenarios.h"
#include "rt/thread_time.h"
#include "simulator/mesh/scene.h"
#include "simulator/reference/solver_motion.h"
#include "simulator/solver/elastic_object.h"

namespace {

using Eigen::Vector3d;
using namespace forcegrid;
using namespace forcegrid::simulator;

constexpr double kRate_Hz = 30.0;
constexpr std::uint64_t kSeed = 1;  // that of --bench
constexpr double kConverged = 1e-7;

struct Step {
  Vector3d force_W = Vector3d::Zero();
  double time_ms = 0.0;
};

template <typename Real>
std::vector<Step> follow(const Scene& scene, const std::vector<Vector3d>& displacements_W,
                         const SolverOptions& options) {
  ElasticObject<Real> object(scene.mesh, options);
  if (object.grab(scene.mesh.top_W, scene.patch_radius_m) == 0) {
    throw std::runtime_error(scene.name + ": the tool holds nothing at its top");
  }
  std::vector<Step> steps;
  for (const Vector3d& displacement_W : displacements_W) {
    const double start_s = rt::thread_time_s();
    const Vector3d force_W = object.move_to(displacement_W).force_W;
    steps.push_back({force_W, 1e3 * (rt::thread_time_s() - start_s)});
  }
  return steps;
}

void print(const Vector3d& v) { std::printf(" %.12g %.12g %.12g", v.x(), v.y(), v.z()); }

void print_object(const Scene& scene, std::size_t ticks) {
  const SpringMesh& mesh = scene.mesh;
  const ElementMaterial& material = mesh.materials.front();
  std::printf("%zu %zu %zu %.17g %.17g\n", mesh.rest_position_W.size(), mesh.tetrahedra.size(),
              ticks, material.youngs_modulus_Pa, material.poissons_ratio);
  for (std::size_t i = 0; i < mesh.rest_position_W.size(); ++i) {
    const Vector3d& position_W = mesh.rest_position_W[i];
    const bool near = (position_W - mesh.top_W).norm() <= scene.patch_radius_m;
    std::printf("%.17g %.17g %.17g %d\n", position_W.x(), position_W.y(), position_W.z(),
                mesh.fixed[i] != 0 ? 1 : (near ? 2 : 0));
  }
  for (const Tetrahedron& element : mesh.tetrahedra) {
    std::printf("%d %d %d %d\n", element.vertex[0], element.vertex[1], element.vertex[2],
                element.vertex[3]);
  }
}

int measure(const Scene& scene, double duration_s, const std::vector<double>& tolerances) {
  const std::vector<ElementMaterial>& materials = scene.mesh.materials;
  if (materials.size() != 1 || materials.front().model != ElementModel::kNeoHookean) {
    throw std::runtime_error(scene.name + ": give a scene of one neo-Hookean material");
  }
  std::vector<Vector3d> displacements_W =
      evaluation::displacements_along_motion(kSeed, 1.0 / kRate_Hz);
  displacements_W.resize(std::min(displacements_W.size(),
                                  static_cast<std::size_t>(std::lround(duration_s * kRate_Hz))));
  SolverOptions converged;
  converged.relative_tolerance = kConverged;
  converged.max_steps = 200;
  converged.max_iterations = 4000;
  const std::vector<Step> reference = follow<double>(scene, displacements_W, converged);
  std::vector<std::vector<Step>> ours;
  for (const double tolerance : tolerances) {
    SolverOptions options;
    options.relative_tolerance = tolerance;
    ours.push_back(follow<float>(scene, displacements_W, options));
  }
  print_object(scene, displacements_W.size());
  for (std::size_t tick = 0; tick < displacements_W.size(); ++tick) {
    print(displacements_W[tick]);
    print(reference[tick].force_W);
    for (const std::vector<Step>& steps : ours) {
      print(steps[tick].force_W);
      std::printf(" %.6g", steps[tick].time_ms);
    }
    std::printf("\n");
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: forcegrid_solver_steps SCENE SECONDS TOLERANCE...\n");
    return 2;
  }
  try {
    std::vector<double> tolerances;
    for (int i = 3; i < argc; ++i) {
      tolerances.push_back(std::stod(argv[i]));
    }
    return measure(make_scene(argv[1]), std::stod(argv[2]), tolerances);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forcegrid_solver_steps: %s\n", error.what());
    return 1;
  }
}
