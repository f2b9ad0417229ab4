// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/model_choice.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/reference/solver_motion.h"
#include "simulator/touch/solver_choice.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using text::number_text;

constexpr double kLeastRate_Hz = 10.0;
constexpr double kMostRate_Hz = 100.0;
constexpr double kReach_m = 0.01;
constexpr double kReachOfHeight = 0.1;
constexpr double kWorthIt = 0.9;  // of the cost of the scene as written
constexpr int kPasses = 2;

struct Model {
  std::string name;
  std::shared_ptr<const Scene> scene;
  SolverKind solver;
};

double height_m(const SpringMesh& mesh) {
  double low_m = mesh.rest_position_W.front().z();
  double high_m = low_m;
  for (const Vector3d& vertex_W : mesh.rest_position_W) {
    low_m = std::min(low_m, vertex_W.z());
    high_m = std::max(high_m, vertex_W.z());
  }
  return high_m - low_m;
}

// Presses, then pulls, with shear all the time; begins at rest.
std::vector<Vector3d> motion_W(const SpringMesh& mesh, double rate_Hz) {
  const double reach_m = std::min(kReach_m, kReachOfHeight * height_m(mesh));
  std::vector<Vector3d> path_W;
  for (int tick = 0; tick <= static_cast<int>(rate_Hz); ++tick) {
    const double turn = std::numbers::pi * tick / rate_Hz;
    path_W.push_back(reach_m * Vector3d(0.5 * std::sin(3.0 * turn), 0.3 * std::sin(5.0 * turn),
                                        -std::sin(2.0 * turn)));
  }
  return path_W;
}

bool all_corotated(const SpringMesh& mesh) {
  return std::all_of(mesh.materials.begin(), mesh.materials.end(), [](const auto& material) {
    return material.model == ElementModel::kCorotated;
  });
}

std::string name_of(const SpringMesh& mesh) {
  const ElementModel first = mesh.materials.front().model;
  const bool same = std::all_of(mesh.materials.begin(), mesh.materials.end(),
                                [first](const auto& material) { return material.model == first; });
  return std::string(same ? name_of(first) : "materials as written") + ", " +
         std::to_string(mesh.tetrahedra.size()) + " elements";
}

// All models of one mesh: its materials and corotated ones, each with every solver.
void add_models(const Scene& scene, SpringMesh mesh, const std::vector<SolverKind>& solvers,
                std::vector<Model>& models) {
  const auto add = [&](SpringMesh made) {
    auto variant = std::make_shared<Scene>(scene);
    variant->mesh = std::move(made);
    for (const SolverKind solver : solvers) {
      models.push_back({name_of(variant->mesh) + ", " + to_string(solver), variant, solver});
    }
  };
  // Under gravity an object rests in its own material only.
  const bool can_be_corotated = !all_corotated(mesh) && mesh.unstrained_W.empty();
  add(mesh);
  if (can_be_corotated) {
    for (ElementMaterial& material : mesh.materials) {
      material.model = ElementModel::kCorotated;
    }
    add(std::move(mesh));
  }
}

void check(const Scene& scene, const ModelOptions& options) {
  if (scene.mesh.tetrahedra.empty()) {
    throw Error("material tolerance: scene " + scene.name +
                " has no finite elements, whose material or mesh could be a cheaper one; leave "
                "--material-tolerance-percent out");
  }
  if (!(options.tolerance_percent > 0.0) || !(options.rate_Hz > 0.0)) {
    throw Error("material tolerance: " + number_text(options.tolerance_percent) + " % at " +
                number_text(options.rate_Hz) + " answers per second; give more than 0");
  }
  if (options.solver && *options.solver != SolverKind::kQuasiStatic &&
      *options.solver != SolverKind::kLocal) {
    throw Error(std::string("material tolerance: solver ") + to_string(*options.solver) +
                ": models are compared by quasi_static and local; give one of these, or leave "
                "--material-tolerance-percent out");
  }
}

// Begins with the scene as written.
std::vector<Model> models_of(const Scene& scene, const ModelOptions& options,
                             std::vector<std::string>& left_out) {
  const std::vector<SolverKind> solvers =
      options.solver ? std::vector<SolverKind>{*options.solver}
                     : std::vector<SolverKind>{SolverKind::kQuasiStatic, SolverKind::kLocal};
  std::vector<Model> models;
  add_models(scene, scene.mesh, solvers, models);
  for (const Fineness fineness : {Fineness::kTwoThirds, Fineness::kHalf}) {
    const std::string edges = fineness == Fineness::kHalf ? "2" : "1.5";
    try {
      SpringMesh coarser = options.coarser(fineness);
      require_held(ElasticObject<float>(coarser).grab(coarser.top_W, scene.patch_radius_m), scene);
      add_models(scene, std::move(coarser), solvers, models);
    } catch (const Error& error) {
      left_out.push_back("edges " + edges + " times as long: " + error.what());
    }
  }
  return models;
}

SolverOptions solver_options(const Model& model, const ModelOptions& options) {
  return choose_solver(model.solver, model.scene->mesh.rest_position_W.size(), options.rate_Hz,
                       options.solver_options)
      .options;
}

std::function<SolverSubject()> subject_of(const Model& model, const ModelOptions& options) {
  const SolverOptions solver = solver_options(model, options);
  return [scene = model.scene, solver] { return elastic_subject(*scene, solver, ""); };
}

std::string milliseconds(double time_ms) {
  return number_text(std::round(1e3 * time_ms) / 1e3) + " ms";
}

std::string percent(double value) { return number_text(std::round(1e4 * value) / 1e4) + " %"; }

std::string figures(const ModelTrial& trial) {
  return trial.model + ": " + milliseconds(trial.mean_ms) + " an answer, " +
         percent(trial.error_percent) + " of force from the scene as written";
}

std::string why(const ModelChoice& choice, std::size_t written, double tolerance_percent) {
  const ModelTrial& chosen = choice.trials[choice.chosen];
  std::string text = figures(chosen);
  if (choice.chosen == written) {
    text = "the scene as written, " + text;
  } else {
    text += ", which takes " + milliseconds(choice.trials[written].mean_ms);
  }
  if (!choice.within) {
    return text + "; no model is within " + number_text(tolerance_percent) +
           " %, give a larger --material-tolerance-percent";
  }
  if (choice.chosen == 0) {
    return text + "; none is cheaper";
  }
  const ModelTrial& cheaper = choice.trials[choice.chosen - 1];
  const double missed = cheaper.error_percent - tolerance_percent;
  return text + "; the next cheaper one, " + figures(cheaper) +
         (missed > 0.0
              ? ", misses by " + percent(missed)
              : ", would save less than " + number_text(100.0 - 100.0 * kWorthIt) + " % of that");
}

}  // namespace

ModelChoice choose_model(const Scene& scene, const ModelOptions& options) {
  check(scene, options);
  const double rate_Hz = std::clamp(options.rate_Hz, kLeastRate_Hz, kMostRate_Hz);
  ModelChoice choice;
  const std::vector<Model> models = models_of(scene, options, choice.left_out);
  const SolverMotion motion(scene, motion_W(scene.mesh, rate_Hz), rate_Hz, 0.0);
  std::vector<std::function<SolverSubject()>> makes;
  for (const Model& model : models) {
    makes.push_back(subject_of(model, options));
  }
  const std::vector<MotionRow> rows = motion.measure(makes, kPasses);
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(), [&rows](std::size_t a, std::size_t b) {
    return rows[a].mean_ms < rows[b].mean_ms;
  });
  for (const std::size_t i : order) {
    choice.trials.push_back(
        {models[i].name, models[i].solver, rows[i].mean_ms, rows[i].error_percent});
  }
  const auto written =
      static_cast<std::size_t>(std::find(order.begin(), order.end(), 0U) - order.begin());
  choice.chosen = written;
  choice.within = false;
  for (std::size_t k = 0; k < order.size() && !choice.within; ++k) {
    const bool worth_it = k == written || rows[0].error_percent > options.tolerance_percent ||
                          choice.trials[k].mean_ms < kWorthIt * choice.trials[written].mean_ms;
    if (choice.trials[k].error_percent <= options.tolerance_percent && worth_it) {
      choice.chosen = k;
      choice.within = true;
    }
  }
  const Model& model = models[order[choice.chosen]];
  choice.mesh = model.scene->mesh;
  choice.solver = model.solver;
  choice.solver_options = solver_options(model, options);
  choice.why = why(choice, written, options.tolerance_percent);
  return choice;
}

}  // namespace forcegrid::simulator
