// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/unit_responses.h"

#include <cmath>
#include <string>
#include <utility>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

SolverOptions unit_response_solver() {
  SolverOptions solver;
  solver.relative_tolerance = 1e-6;
  solver.max_step_m = 1e-3;
  solver.max_steps = 200;
  solver.max_iterations = 2000;
  return solver;
}

// The force at `displacement_W` from rest, with the patch at `point_W` held.
Vector3d solved_force_W(ElasticObject<double>& object, const Vector3d& point_W,
                        const Vector3d& displacement_W, double patch_radius_m) {
  object.release();
  if (object.grab(point_W, patch_radius_m) == 0) {
    throw Error("unit-responses: no free vertex within " + std::to_string(patch_radius_m) +
                " m of a place; move the place onto the object or use a larger grip");
  }
  const Equilibrium answer = object.move_to(displacement_W);
  if (!answer.converged || !answer.reached) {
    throw Error("unit-responses: no equilibrium was found with the patch " +
                std::to_string(displacement_W.norm()) + " m away from rest; use a smaller step_m");
  }
  return answer.force_W;
}

}  // namespace

std::shared_ptr<const UnitResponseTable> make_unit_responses(const SpringMesh& mesh,
                                                             const UnitResponseOptions& options) {
  check_positive(options.patch_radius_m, "unit-responses: patch_radius_m");
  check_positive(options.step_m, "unit-responses: step_m");
  auto table = std::make_shared<UnitResponseTable>();
  table->patch_radius_m = options.patch_radius_m;
  table->step_m = options.step_m;
  std::vector<Vector3d> places_W = options.places_W;
  if (places_W.empty()) {
    places_W.push_back(mesh.top_W);
  }
  ElasticObject<double> object(mesh, unit_response_solver());
  for (const Vector3d& point_W : places_W) {
    UnitResponseTable::Place place;
    place.point_W = point_W;
    for (int column = 0; column < 6; ++column) {
      rt::checkpoint();
      Vector3d displacement_W = Vector3d::Zero();
      displacement_W[column % 3] = column < 3 ? options.step_m : -options.step_m;
      place.force_W.col(column) =
          solved_force_W(object, point_W, displacement_W, options.patch_radius_m);
    }
    table->places.push_back(place);
  }
  return table;
}

UnitResponseMethod::UnitResponseMethod(std::shared_ptr<const UnitResponseTable> table)
    : table_(std::move(table)) {}

std::size_t UnitResponseMethod::memory_bytes() const noexcept {
  return sizeof *this + sizeof *table_ +
         table_->places.capacity() * sizeof(UnitResponseTable::Place);
}

bool UnitResponseMethod::hold(const Vector3d& point_W) noexcept {
  place_ = nullptr;
  double nearest_m = table_->patch_radius_m;
  for (const UnitResponseTable::Place& place : table_->places) {
    const double away_m = (place.point_W - point_W).norm();
    if (away_m <= nearest_m) {
      nearest_m = away_m;
      place_ = &place;
    }
  }
  return place_ != nullptr;
}

Vector3d UnitResponseMethod::response_N(const Vector3d& displacement_W) const noexcept {
  Vector3d force_W = Vector3d::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    const double d_m = displacement_W[axis];
    force_W += std::abs(d_m) / table_->step_m * place_->force_W.col(d_m < 0.0 ? axis + 3 : axis);
  }
  return force_W;
}

}  // namespace forcegrid::simulator
