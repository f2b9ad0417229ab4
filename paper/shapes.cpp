// SPDX-License-Identifier: Apache-2.0
#include "paper/shapes.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/scenarios.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::paper {
namespace {

using Eigen::Vector3d;

// Pulled, sheared both ways and pushed.
const std::array<Vector3d, 5> kDisplacements_W_m{
    Vector3d(0.0, 0.0, 0.016), Vector3d(0.012, 0.0, 0.008), Vector3d(0.0, -0.012, 0.008),
    Vector3d(-0.008, 0.008, 0.012), Vector3d(0.0, 0.0, -0.004)};

struct Shape {
  std::string scene;
  std::vector<Vector3d> seen_W;  // the surface's vertices at one displacement after the other
};

simulator::SolverOptions exact_solver() {
  simulator::SolverOptions solver;
  solver.relative_tolerance = 1e-8;
  solver.max_step_m = 1.5e-3;
  solver.max_steps = 1000;
  solver.max_iterations = 4000;
  return solver;
}

std::set<std::int32_t> surface_of(const simulator::SpringMesh& mesh) {
  std::set<std::int32_t> vertices;
  for (const auto& triangle : mesh.triangles) {
    vertices.insert(triangle.begin(), triangle.end());
  }
  return vertices;
}

// Displacements of the surface's vertices from rest.
Shape shape_of(const std::string& scene) {
  const evaluation::ChartScene& chosen = evaluation::chart_scene(scene);
  const simulator::SpringMesh mesh = evaluation::make_mesh(chosen);
  const std::set<std::int32_t> surface = surface_of(mesh);
  simulator::ElasticObject<double> object(mesh, exact_solver());
  object.grab(evaluation::first_contact_point_W(), chosen.patch_radius_m);
  Shape shape{scene, {}};
  for (const Vector3d& displacement_W : kDisplacements_W_m) {
    object.move_to(displacement_W);
    const std::vector<Vector3d> positions_W = object.positions_W();
    for (const std::int32_t vertex : surface) {
      const auto v = static_cast<std::size_t>(vertex);
      shape.seen_W.push_back(positions_W[v] - mesh.rest_position_W[v]);
    }
  }
  return shape;
}

ShapeDifference difference(const Shape& first, const Shape& second) {
  ShapeDifference result{first.scene, second.scene};
  double sum_m2 = 0.0;
  double motion_m2 = 0.0;
  for (std::size_t k = 0; k < first.seen_W.size(); ++k) {
    const double apart_m = (first.seen_W[k] - second.seen_W[k]).norm();
    result.largest_mm = std::max(result.largest_mm, 1e3 * apart_m);
    sum_m2 += apart_m * apart_m;
    motion_m2 += 0.5 * (first.seen_W[k].squaredNorm() + second.seen_W[k].squaredNorm());
  }
  result.rms_mm = 1e3 * std::sqrt(sum_m2 / static_cast<double>(first.seen_W.size()));
  result.of_motion_percent = 100.0 * std::sqrt(sum_m2 / motion_m2);
  result.d_prime = 1e3 * std::sqrt(sum_m2) / kSeen_mm;
  return result;
}

}  // namespace

std::vector<ShapeDifference> compare_shapes(const PaperOptions& options) {
  std::vector<Shape> shapes;
  for (const std::string& scene : options.plan.objects) {
    check_stop(options);
    shapes.push_back(shape_of(scene));
  }
  return {difference(shapes[0], shapes[1]), difference(shapes[0], shapes[2]),
          difference(shapes[1], shapes[2])};
}

}  // namespace forcegrid::paper
