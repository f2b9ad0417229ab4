// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/solver_bench.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "rt/checkpoint.h"
#include "rt/thread_time.h"
#include "simulator/mesh/error.h"
#include "simulator/reference/solver_motion.h"
#include "simulator/solver/direct_method.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_kind.h"
#include "simulator/touch/solver_choice.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kStep_m = 0.010;
constexpr double kFastBorder = 1e-3;
// For objects whose answers would be late: the prediction's force is sent, as direct does.
constexpr double kAnswerFirstBelow = 0.01;
constexpr int kAnswerFirstIterations = 2;
constexpr int kStepRepeats = 3;
// Repeats guard against other work on the machine; with larger objects one pass takes long enough.
constexpr std::size_t kMostVerticesRepeated = 5'000;
constexpr double kLearningRate_Hz = 100.0;
const std::string kQuasiStatic = to_string(SolverKind::kQuasiStatic);
const std::string kNewton = "newton_cg";
const std::string kReduced = to_string(SolverKind::kReduced);

std::string tolerance_text(double tolerance) { return "|r| " + text::number_text(tolerance); }

bool has_elements(const Scene& scene) { return !scene.mesh.tetrahedra.empty(); }

// Nothing if there is no motion to train on, or for elements. All subjects of a run share the
// model.
std::shared_ptr<ReducedBench> train(const Scene& scene, const SolverBenchOptions& options) {
  return options.training_W.empty() || has_elements(scene)
             ? nullptr
             : std::make_shared<ReducedBench>(scene, options.training_W);
}

SolverSubject reduced(const std::shared_ptr<ReducedBench>& model) {
  return {kReduced, model->setting(), [model](const Vector3d& displacement_W) {
            const Equilibrium e = model->move_to(displacement_W);
            return SolverSubject::Answer{e.force_W, e.relative_residual,
                                         static_cast<double>(e.iterations), 0.0, e.converged};
          }};
}

using Makes = std::vector<std::function<SolverSubject()>>;

void add_elastic(const Scene& scene, const SolverOptions& solver, const std::string& setting,
                 Makes& makes) {
  makes.push_back([&scene, solver, setting] { return elastic_subject(scene, solver, setting); });
}

void add_newton(const Scene& scene, Makes& makes) {
  std::vector<double> tolerances{1e-2, 3e-3, 1e-3, 3e-4, 1e-4};
  if (!has_elements(scene)) {  // whose forces in single precision don't get there
    tolerances.insert(tolerances.end(), {3e-5, 1e-5});
  }
  for (const double tolerance : tolerances) {
    makes.push_back([&scene, tolerance] { return newton_subject(scene, tolerance); });
  }
}

Makes slow_subjects(const Scene& scene) {
  Makes makes;
  for (const double tolerance : {1e-2, 3e-3, 1e-3, 3e-4}) {
    SolverOptions solver;
    solver.relative_tolerance = tolerance;
    add_elastic(scene, solver, tolerance_text(tolerance), makes);
  }
  SolverOptions first;
  first.answer_first_below = kAnswerFirstBelow;
  first.max_iterations = kAnswerFirstIterations;
  add_elastic(scene, first, "answer, then 2 its", makes);
  for (const double border : {1e-2, 3e-3, 1e-3}) {
    SolverOptions solver;
    solver.border_tolerance = border;
    add_elastic(scene, solver, "border " + text::number_text(border), makes);
  }
  add_newton(scene, makes);
  return makes;
}

Makes fast_subjects(const Scene& scene) {
  Makes makes;
  SolverOptions direct = DirectOptions{}.solver;
  add_elastic(scene, direct, "as direct", makes);
  direct.answer_first_below = 0.0;
  add_elastic(scene, direct, "correct, then answer", makes);
  SolverOptions local = DirectOptions{}.solver;
  local.border_tolerance = kFastBorder;
  add_elastic(scene, local, "as direct", makes);
  add_newton(scene, makes);
  return makes;
}

void measure_motion(const Scene& scene, const SolverBenchOptions& options,
                    SolverBenchResult& result) {
  const auto say = [&options](const std::string& text) {
    if (options.say) {
      options.say(text);
    }
  };
  const int passes =
      scene.mesh.rest_position_W.size() <= kMostVerticesRepeated ? options.passes : 1;
  const auto measure = [&](const SolverMotion& motion, const SolverSubject& subject) {
    say(subject.name + ", " + subject.setting);
    result.motion.push_back(motion.measure(subject));
  };
  const auto measure_all = [&](const SolverMotion& motion, const Makes& makes) {
    const std::vector<MotionRow> rows = motion.measure(makes, passes);
    result.motion.insert(result.motion.end(), rows.begin(), rows.end());
  };
  say("converged forces at 30 Hz");
  const SolverMotion slow(scene, options.at_30_Hz_W, 30.0, options.settling_s);
  say("solvers at 30 Hz, in turn, " + std::to_string(passes) + " times");
  measure_all(slow, slow_subjects(scene));
  const std::shared_ptr<ReducedBench> model = train(scene, options);
  if (model) {
    measure(slow, reduced(model));
    say("reduced, its states");
    result.reduced.push_back(model->compare_states(options.at_30_Hz_W));
  }
  say("converged forces at 500 Hz");
  const SolverMotion fast(scene, options.at_500_Hz_W, 500.0, options.settling_s);
  say("solvers at 500 Hz, in turn, " + std::to_string(passes) + " times");
  measure_all(fast, fast_subjects(scene));
  measure(fast, two_rates_subject(scene, two_rates_options(500.0, {}), "as direct"));
  if (model) {
    measure(fast, reduced(model));
  }
}

// Time from which on `reached` holds for all later points. If the points are solved from rest each,
// a later one may be the quicker.
template <typename Reached>
double time_until_ms(const std::vector<StepPoint>& points, Reached reached) {
  double time_ms = kNever;
  for (auto point = points.rbegin(); point != points.rend() && reached(*point); ++point) {
    time_ms = std::min(time_ms, point->time_ms);
  }
  return time_ms;
}

StepRow step_row(std::string solver, const std::vector<StepPoint>& points, double vertices) {
  StepRow row{.solver = std::move(solver), .least_error_percent = kNever, .vertices = vertices};
  const auto residual = [&points](double most) {
    return time_until_ms(points,
                         [most](const StepPoint& p) { return p.relative_residual <= most; });
  };
  const auto error = [&points](double most) {
    return time_until_ms(points, [most](const StepPoint& p) { return p.error_percent <= most; });
  };
  row.first_error_1_ms = kNever;
  for (auto point = points.rbegin(); point != points.rend(); ++point) {
    if (point->error_percent <= 1.0) {
      row.first_error_1_ms = point->time_ms;
    }
  }
  row.to_residual_1e2_ms = residual(1e-2);
  row.to_residual_1e3_ms = residual(1e-3);
  row.to_error_1_ms = error(1.0);
  row.to_error_01_ms = error(0.1);
  for (const StepPoint& point : points) {
    row.least_error_percent = std::min(row.least_error_percent, point.error_percent);
  }
  return row;
}

// One point per tolerance, each from rest; the quickest of the repeats.
std::vector<StepPoint> step_points(const std::function<SolverSubject(double tolerance)>& make,
                                   const Vector3d& displacement_W, const Vector3d& converged_W) {
  std::vector<StepPoint> points;
  constexpr int kTolerances = 17;
  for (int k = 0; k < kTolerances; ++k) {
    const double exponent = -0.5 - 0.25 * k;
    StepPoint point{.time_ms = kNever};
    for (int repeat = 0; repeat < kStepRepeats; ++repeat) {
      rt::checkpoint(static_cast<std::size_t>(k * kStepRepeats + repeat),
                     static_cast<std::size_t>(kTolerances * kStepRepeats));
      const SolverSubject subject = make(std::pow(10.0, exponent));
      const double start_s = rt::thread_time_s();
      const SolverSubject::Answer answer = subject.move_to(displacement_W);
      point.time_ms = std::min(point.time_ms, 1e3 * (rt::thread_time_s() - start_s));
      point.relative_residual = answer.relative_residual;
      point.error_percent = 100.0 * (answer.force_W - converged_W).norm() / converged_W.norm();
    }
    points.push_back(point);
  }
  return points;
}

Scene with_linear_springs(Scene scene) {
  for (SpringLaw& law : scene.mesh.laws) {
    law = SpringLaw{};
  }
  return scene;
}

void measure_step(const Scene& asked, const SolverBenchOptions& options,
                  SolverBenchResult& result) {
  if (has_elements(asked)) {
    result.remarks.push_back(
        "no reduced model and no step with linear springs: this scene has "
        "finite elements, and they know springs only");
    return;
  }
  if (!asked.mesh.load_W_N.empty() || !asked.mesh.home_stiffness_N_per_m.empty()) {
    result.remarks.push_back(
        "no step with linear springs: this scene has home springs or dead loads, which the peers "
        "don't know; block_linear has none");
    return;
  }
  if (options.say) {
    options.say("step of 10 mm with linear springs");
  }
  const Scene scene = with_linear_springs(asked);
  const Vector3d displacement_W(0.0, 0.0, kStep_m);
  ElasticObject<double> reference(scene.mesh, {.relative_tolerance = 1e-7, .max_iterations = 4000});
  require_held(reference.grab(scene.mesh.top_W, scene.patch_radius_m), scene);
  const Vector3d converged_W = reference.move_to(displacement_W).force_W;
  const auto vertices = static_cast<double>(scene.mesh.rest_position_W.size());
  const auto ours = [&scene](double tolerance) {
    SolverOptions solver;
    solver.max_step_m = kStep_m;  // linear springs allow it
    solver.relative_tolerance = tolerance;
    return elastic_subject(scene, solver, {});
  };
  const auto plain = [&scene](double tolerance) { return newton_subject(scene, tolerance); };
  {
    const rt::PartOfWork half(0.0, 0.5);
    result.step.push_back(
        step_row(kQuasiStatic, step_points(ours, displacement_W, converged_W), vertices));
  }
  {
    const rt::PartOfWork half(0.5, 1.0);
    result.step.push_back(
        step_row(kNewton, step_points(plain, displacement_W, converged_W), vertices));
  }
  for (const StepPeer& peer : options.peers) {
    if (options.say) {
      options.say("step, " + peer.name);
    }
    result.step.push_back(
        step_row(peer.name, peer.run(scene, displacement_W, converged_W), vertices));
  }
}

void measure_learning(const Scene& scene, const SolverBenchOptions& options,
                      SolverBenchResult& result) {
  if (options.learning_W.empty() || has_elements(scene)) {
    return;
  }
  if (options.say) {
    options.say("reduced, learning on the way");
  }
  result.learning.push_back(bench_learning(scene, options.learning_W, kLearningRate_Hz));
}

void find_ratios(SolverBenchResult& result) {
  const bool has_peer = std::any_of(result.motion.begin(), result.motion.end(),
                                    [](const MotionRow& row) { return row.solver == kNewton; });
  if (!has_peer) {
    return;
  }
  for (const MotionRow& ours : result.motion) {
    if (ours.solver == kNewton) {
      continue;
    }
    double cheapest_ms = kNever;
    for (const MotionRow& peer : result.motion) {
      if (peer.solver == kNewton && peer.rate_Hz == ours.rate_Hz &&
          peer.error_percent <= ours.error_percent) {
        cheapest_ms = std::min(cheapest_ms, peer.mean_ms);
      }
    }
    result.ratios.push_back({ours.solver + ", " + ours.setting, kNewton,
                             text::number_text(ours.rate_Hz) + " Hz, same force error",
                             cheapest_ms / ours.mean_ms});
  }
  for (std::size_t k = 1; k < result.step.size(); ++k) {
    const StepRow& ours = result.step.front();
    const StepRow& peer = result.step[k];
    result.ratios.push_back({ours.solver, peer.solver, "step, first at 1 %",
                             peer.first_error_1_ms / ours.to_error_1_ms});
    result.ratios.push_back(
        {ours.solver, peer.solver, "step, to 0.1 %", peer.to_error_01_ms / ours.to_error_01_ms});
  }
}

nlohmann::json number_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

}  // namespace

SolverBenchResult bench_solvers(const Scene& scene, const SolverBenchOptions& options) {
  SolverBenchResult result{.scene = scene.name,
                           .vertices = scene.mesh.rest_position_W.size(),
                           .springs = scene.mesh.springs.size(),
                           .tetrahedra = scene.mesh.tetrahedra.size()};
  measure_motion(scene, options, result);
  measure_step(scene, options, result);
  measure_learning(scene, options, result);
  result.dynamic = bench_dynamic(scene, options.at_30_Hz_W, 30.0, options.say);
  find_ratios(result);
  return result;
}

nlohmann::json to_json(const SolverBenchResult& result) {
  nlohmann::json json{{"scene", result.scene},
                      {"vertices", result.vertices},
                      {"springs", result.springs},
                      {"tetrahedra", result.tetrahedra},
                      {"remarks", result.remarks},
                      {"motion", nlohmann::json::array()},
                      {"step", nlohmann::json::array()},
                      {"dynamic", nlohmann::json::array()},
                      {"reduced", nlohmann::json::array()},
                      {"learning", nlohmann::json::array()},
                      {"ratios", nlohmann::json::array()}};
  for (const MotionRow& row : result.motion) {
    json["motion"].push_back({{"solver", row.solver},
                              {"rate_Hz", row.rate_Hz},
                              {"setting", row.setting},
                              {"ticks", row.ticks},
                              {"mean_ms", row.mean_ms},
                              {"median_ms", row.median_ms},
                              {"max_ms", row.max_ms},
                              {"error_percent", row.error_percent},
                              {"max_error_percent", row.max_error_percent},
                              {"residual_mean", row.residual_mean},
                              {"iterations_mean", row.iterations_mean},
                              {"vertices_mean", row.vertices_mean},
                              {"unconverged", row.unconverged},
                              {"whole_mean_ms", row.whole_mean_ms}});
  }
  for (const StepRow& row : result.step) {
    json["step"].push_back({{"solver", row.solver},
                            {"to_residual_1e-2_ms", number_or_null(row.to_residual_1e2_ms)},
                            {"to_residual_1e-3_ms", number_or_null(row.to_residual_1e3_ms)},
                            {"first_at_error_1_percent_ms", number_or_null(row.first_error_1_ms)},
                            {"to_error_1_percent_ms", number_or_null(row.to_error_1_ms)},
                            {"to_error_0.1_percent_ms", number_or_null(row.to_error_01_ms)},
                            {"least_error_percent", number_or_null(row.least_error_percent)},
                            {"vertices", row.vertices}});
  }
  for (const DynamicRow& row : result.dynamic) {
    json["dynamic"].push_back({{"step_s", row.step_s},
                               {"steps", row.steps},
                               {"step_mean_ms", row.mean_ms},
                               {"step_max_ms", row.max_ms},
                               {"iterations_mean", row.iterations_mean},
                               {"unconverged", row.unconverged},
                               {"static_error_percent", row.static_error_percent},
                               {"static_after_s", row.static_after_s},
                               {"released_J", row.released_J},
                               {"energy_after_100ms_percent", row.after_100ms_percent},
                               {"energy_largest_rise_percent", row.largest_rise_percent}});
  }
  for (const ReducedRow& row : result.reduced) {
    json["reduced"].push_back(to_json(row));
  }
  for (const LearningRow& row : result.learning) {
    json["learning"].push_back(to_json(row));
  }
  for (const SpeedRatio& ratio : result.ratios) {
    json["ratios"].push_back({{"solver", ratio.solver},
                              {"peer", ratio.peer},
                              {"at", ratio.at},
                              {"ratio", number_or_null(ratio.ratio)}});
  }
  return json;
}

}  // namespace forcegrid::simulator
