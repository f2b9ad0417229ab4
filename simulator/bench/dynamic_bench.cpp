// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/dynamic_bench.h"

#include <algorithm>
#include <cmath>

#include "rt/checkpoint.h"
#include "rt/thread_time.h"
#include "simulator/bench/solver_bench.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/tetrahedra.h"
#include "simulator/solver/dynamic_object.h"
#include "simulator/solver/elastic_object.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kStill_s = 3.0;
constexpr double kSwing_s = 0.5;
constexpr double kEarly_s = 0.1;
constexpr int kMostSteps = 100'000;

double spring_energy_J(const SpringLaw& law, double stiffness_N_per_m, double natural_m,
                       double length_m) {
  const double e = length_m / natural_m - 1.0;
  const double a = law.exponent;
  const double from_g = a > 0.0 ? (std::cosh(a * e) - 1.0) / (a * a) : 0.5 * e * e;
  return stiffness_N_per_m * natural_m * natural_m *
         (from_g + 0.25 * law.cubic_coefficient * e * e * e * e);
}

void measure_motion(DynamicObject& object, const std::vector<Vector3d>& displacements_W,
                    double period_s, DynamicRow& row) {
  double spent_ms = 0.0;
  double iterations = 0.0;
  std::size_t done = 0;
  for (const Vector3d& displacement_W : displacements_W) {
    rt::checkpoint(done++, displacements_W.size());
    const double start_s = rt::thread_time_s();
    const Equilibrium moved = object.advance(period_s, displacement_W);
    const double time_ms = 1e3 * (rt::thread_time_s() - start_s);
    spent_ms += time_ms;
    row.max_ms = std::max(row.max_ms, time_ms / moved.steps);
    row.steps += static_cast<std::size_t>(moved.steps);
    iterations += moved.iterations;
    row.unconverged += moved.converged ? 0.0 : 1.0 / static_cast<double>(displacements_W.size());
  }
  row.mean_ms = spent_ms / static_cast<double>(row.steps);
  row.iterations_mean = iterations / static_cast<double>(row.steps);
}

void measure_swing(DynamicObject& object, const SpringMesh& mesh, DynamicRow& row) {
  const auto over_rest_J = [&, rest_J = energy_J(mesh, mesh.rest_position_W, {})] {
    return energy_J(mesh, object.positions_W(), object.velocities_W()) - rest_J;
  };
  object.release();
  row.released_J = over_rest_J();
  double before_J = row.released_J;
  const int steps = static_cast<int>(std::lround(kSwing_s / row.step_s));
  for (int step = 1; step <= steps; ++step) {
    rt::checkpoint(static_cast<std::size_t>(step - 1), static_cast<std::size_t>(steps));
    object.advance(row.step_s, Vector3d::Zero());
    const double now_J = over_rest_J();
    row.largest_rise_percent =
        std::max(row.largest_rise_percent, 100.0 * (now_J - before_J) / row.released_J);
    if (step * row.step_s <= kEarly_s * (1.0 + 1e-9)) {
      row.after_100ms_percent = 100.0 * now_J / row.released_J;
    }
    before_J = now_J;
  }
}

}  // namespace

double energy_J(const SpringMesh& mesh, const std::vector<Vector3d>& position_W,
                const std::vector<Vector3d>& velocity_W) {
  double sum_J = 0.0;
  for (const Spring& spring : mesh.springs) {
    const double length_m = (position_W[static_cast<std::size_t>(spring.a)] -
                             position_W[static_cast<std::size_t>(spring.b)])
                                .norm();
    sum_J += spring_energy_J(mesh.laws[static_cast<std::size_t>(spring.law)],
                             spring.stiffness_N_per_m, natural_length_m(mesh, spring), length_m);
  }
  const std::vector<Vector3d>& unstrained = unstrained_W(mesh);
  for (const Tetrahedron& element : mesh.tetrahedra) {
    const ElementShape shape = element_shape(unstrained, element);
    sum_J += shape.volume_m3 *
             strain_energy_J_per_m3(mesh.materials[static_cast<std::size_t>(element.material)],
                                    deformation_gradient(shape, element, position_W));
  }
  for (std::size_t i = 0; i < position_W.size(); ++i) {
    const Vector3d off_m = position_W[i] - mesh.rest_position_W[i];
    if (!mesh.home_stiffness_N_per_m.empty()) {
      sum_J += 0.5 * mesh.home_stiffness_N_per_m[i] * off_m.squaredNorm();
    }
    if (!mesh.load_W_N.empty()) {
      sum_J -= mesh.load_W_N[i].dot(off_m);
    }
  }
  for (std::size_t i = 0; i < velocity_W.size(); ++i) {
    sum_J += 0.5 * mesh.mass_kg[i] * velocity_W[i].squaredNorm();
  }
  return sum_J;
}

std::vector<DynamicRow> bench_dynamic(const Scene& scene,
                                      const std::vector<Vector3d>& displacements_W, double rate_Hz,
                                      const std::function<void(const std::string&)>& say) {
  if (displacements_W.empty()) {
    throw Error("bench: no displacements to move an object with; give some");
  }
  std::vector<DynamicRow> rows;
  if (scene.mesh.mass_kg.empty()) {
    return rows;
  }
  ElasticObject<double> still(scene.mesh, {.relative_tolerance = 1e-7, .max_iterations = 4000});
  if (still.grab(scene.mesh.top_W, scene.patch_radius_m) == 0) {
    throw Error("bench: no free vertex within " + text::number_text(scene.patch_radius_m) +
                " m of the top of scene " + scene.name + "; use a larger patch_radius_m");
  }
  Equilibrium converged = still.move_to(displacements_W.back());
  while (!converged.reached) {
    converged = still.move_to(displacements_W.back());
  }
  const double period_s = 1.0 / rate_Hz;
  for (const double step_s : {1e-3, 2e-3, 4e-3, period_s}) {
    if (say) {
      say("dynamic, steps of " + text::number_text(std::round(1e4 * step_s) / 10.0) + " ms");
    }
    DynamicRow row{.step_s = step_s, .static_after_s = kStill_s};
    DynamicObject object(scene.mesh, {.step_s = step_s, .max_steps = kMostSteps});
    object.grab(scene.mesh.top_W, scene.patch_radius_m);
    measure_motion(object, displacements_W, period_s, row);
    const Vector3d force_W = object.advance(kStill_s, displacements_W.back()).force_W;
    row.static_error_percent =
        100.0 * (force_W - converged.force_W).norm() / converged.force_W.norm();
    measure_swing(object, scene.mesh, row);
    rows.push_back(row);
  }
  return rows;
}

}  // namespace forcegrid::simulator
