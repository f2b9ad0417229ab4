#include "simulator/reduced_bench.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "profiles/text.h"
#include "simulator/error.h"
#include "simulator/reduced_training.h"
#include "simulator/solver_bench.h"

namespace forcegrid::simulator {
namespace {

constexpr double kStateTolerance = 1e-4;

ElasticObject<float> held(const Scene& scene, double relative_tolerance) {
  ElasticObject<float> object(scene.mesh, {.relative_tolerance = relative_tolerance});
  if (object.grab(scene.mesh.top_W, scene.patch_radius_m) == 0) {
    throw Error("bench: no free vertex within " + profiles::number_text(scene.patch_radius_m) +
                " m of the top of scene " + scene.name + "; use a larger patch_radius_m");
  }
  return object;
}

}  // namespace

struct ReducedBench::Parts {
  const Scene& scene;
  ReducedTraining training;
  ReducedRow row;
};

ReducedBench::ReducedBench(const Scene& scene, const std::vector<Eigen::Vector3d>& training_W) {
  ElasticObject<float> full = held(scene, SolverOptions{}.relative_tolerance);
  ReducedTrainingSet set = begin_training_set(scene.mesh, full);
  for (const Eigen::Vector3d& displacement_W : training_W) {
    add_state(scene.mesh, full, full.move_to(displacement_W), {}, set);
  }
  const double start_s = thread_time_s();
  parts_ = std::make_unique<Parts>(Parts{scene, train_reduced_model(scene.mesh, set), {}});
  ReducedRow& row = parts_->row;
  row.training_s = thread_time_s() - start_s;
  row.states = set.snapshots.size();
  row.modes = parts_->training.model->modes();
  row.springs = parts_->training.model->springs();
  row.memory_bytes = parts_->training.model->memory_bytes();
  row.training_error_percent = 100.0 * parts_->training.training_error;
}

ReducedBench::~ReducedBench() = default;
ReducedBench::ReducedBench(ReducedBench&&) noexcept = default;

std::string ReducedBench::setting() const {
  return std::to_string(parts_->row.modes) + " modes, " + std::to_string(parts_->row.springs) +
         " springs";
}

Equilibrium ReducedBench::move_to(const Eigen::Vector3d& displacement_W) noexcept {
  return parts_->training.model->move_to(displacement_W);
}

ReducedRow ReducedBench::compare_states(const std::vector<Eigen::Vector3d>& displacements_W) {
  ReducedRow row = parts_->row;
  ReducedModel& model = *parts_->training.model;
  ElasticObject<float> full = held(parts_->scene, kStateTolerance);
  double error2_m2 = 0.0;
  double largest2_m2 = 0.0;
  double moved2_m2 = 0.0;
  for (const Eigen::Vector3d& displacement_W : displacements_W) {
    const ReducedSnapshot state =
        take_snapshot(parts_->scene.mesh, full, full.move_to(displacement_W));
    model.move_to(state.displacement_W);
    const Eigen::VectorXf moved_m = parts_->training.basis * model.coordinates().cast<float>();
    const double here2_m2 = static_cast<double>((moved_m - state.moved_m).squaredNorm());
    error2_m2 += here2_m2;
    largest2_m2 = std::max(largest2_m2, here2_m2);
    moved2_m2 += static_cast<double>(state.moved_m.squaredNorm());
    row.farthest_mm = std::max(row.farthest_mm, 1e3 * model.distance_m(displacement_W));
  }
  row.state_error_percent = 100.0 * std::sqrt(error2_m2 / moved2_m2);
  row.max_state_error_percent =
      100.0 * std::sqrt(largest2_m2 * static_cast<double>(displacements_W.size()) / moved2_m2);
  return row;
}

nlohmann::json to_json(const ReducedRow& row) {
  return {{"states", row.states},
          {"training_s", row.training_s},
          {"modes", row.modes},
          {"springs", row.springs},
          {"memory_bytes", row.memory_bytes},
          {"training_error_percent", row.training_error_percent},
          {"state_error_percent", row.state_error_percent},
          {"max_state_error_percent", row.max_state_error_percent},
          {"farthest_mm", row.farthest_mm}};
}

}  // namespace forcegrid::simulator
