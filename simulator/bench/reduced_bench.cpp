// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/reduced_bench.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "rt/checkpoint.h"
#include "rt/percentiles.h"
#include "rt/thread_time.h"
#include "simulator/bench/solver_bench.h"
#include "simulator/mesh/error.h"
#include "simulator/reference/solver_motion.h"
#include "simulator/solver/reduced_object.h"
#include "simulator/solver/reduced_training.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

constexpr double kStateTolerance = 1e-4;

ElasticObject<float> held(const Scene& scene, double relative_tolerance) {
  ElasticObject<float> object(scene.mesh, {.relative_tolerance = relative_tolerance});
  require_held(object.grab(scene.mesh.top_W, scene.patch_radius_m), scene);
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
  std::size_t done = 0;
  for (const Eigen::Vector3d& displacement_W : training_W) {
    rt::checkpoint(done++, training_W.size());
    add_state(scene.mesh, full, full.move_to(displacement_W), {}, set);
  }
  const double start_s = rt::thread_time_s();
  parts_ = std::make_unique<Parts>(Parts{scene, train_reduced_model(scene.mesh, set), {}});
  ReducedRow& row = parts_->row;
  row.training_s = rt::thread_time_s() - start_s;
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
  std::size_t done = 0;
  for (const Eigen::Vector3d& displacement_W : displacements_W) {
    rt::checkpoint(done++, displacements_W.size());
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

LearningRow bench_learning(const Scene& scene, const std::vector<Eigen::Vector3d>& displacements_W,
                           double rate_Hz) {
  if (displacements_W.empty()) {
    throw Error("bench: learning on the way needs a motion; give at least one displacement");
  }
  ReducedObjectOptions options;
  options.own_threads = false;
  ReducedObject object(scene.mesh, options);
  require_held(object.grab(scene.mesh.top_W, scene.patch_radius_m), scene);
  ElasticObject<float> full = held(scene, kStateTolerance);
  LearningRow row{.answers = displacements_W.size(), .rate_Hz = rate_Hz};
  double model_error2_N2 = 0.0;
  double largest2_N2 = 0.0;
  double force2_N2 = 0.0;
  rt::Percentiles times_us;
  std::size_t done = 0;
  for (const Eigen::Vector3d& displacement_W : displacements_W) {
    rt::checkpoint(done++, displacements_W.size());
    const Equilibrium answer = object.move_to(displacement_W);
    const Eigen::Vector3d full_W = full.move_to(displacement_W).force_W;
    const double error2_N2 = (answer.force_W - full_W).squaredNorm();
    force2_N2 += full_W.squaredNorm();
    largest2_N2 = std::max(largest2_N2, error2_N2);
    if (object.use().in_use) {
      model_error2_N2 += error2_N2;
      times_us.add(1e6 * answer.solve_time_s);
    }
  }
  const auto count = static_cast<double>(row.answers);
  const auto by_model = static_cast<double>(times_us.count());
  const double mean2_N2 = force2_N2 / count;
  row.by_model_percent = 100.0 * by_model / count;
  row.model_error_percent = 100.0 * std::sqrt(model_error2_N2 / std::max(1.0, by_model) / mean2_N2);
  row.max_error_percent = 100.0 * std::sqrt(largest2_N2 / mean2_N2);
  row.model_median_ms = 1e-3 * times_us.at(0.5);
  row.model_p99_ms = 1e-3 * times_us.at(0.99);
  row.trainings = object.use().trainings;
  row.checks = object.use().checks;
  row.failed_checks = object.use().failed_checks;
  return row;
}

nlohmann::json to_json(const LearningRow& row) {
  return {{"answers", row.answers},
          {"rate_Hz", row.rate_Hz},
          {"by_model_percent", row.by_model_percent},
          {"model_error_percent", row.model_error_percent},
          {"max_error_percent", row.max_error_percent},
          {"model_median_ms", row.model_median_ms},
          {"model_p99_ms", row.model_p99_ms},
          {"trainings", row.trainings},
          {"checks", row.checks},
          {"failed_checks", row.failed_checks}};
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
