#include "simulator/solver_bench.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "profiles/text.h"
#include "rt/percentiles.h"
#include "simulator/direct_method.h"
#include "simulator/elastic_object.h"
#include "simulator/error.h"
#include "simulator/newton_object.h"
#include "simulator/truth.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kStep_m = 0.010;
constexpr double kFastBorder = 1e-3;
constexpr int kWholeIterations = 9;
constexpr int kMostVertices = 2500;  // between whole solutions
constexpr int kStepRepeats = 3;
const std::string kQuasiStatic = "quasi_static";
const std::string kLocal = "local";
const std::string kNewton = "newton_cg";
const std::string kReduced = "reduced";

struct Answer {
  Vector3d force_W = Vector3d::Zero();
  double relative_residual = 0.0;
  double iterations = 0.0;
  double vertices = 0.0;
  bool converged = false;
};

// A solver that holds the scene's top at rest.
struct Subject {
  std::string name;
  std::string setting;
  std::function<Answer(const Vector3d& displacement_W)> move_to;
};

std::string tolerance_text(double tolerance) { return "|r| " + profiles::number_text(tolerance); }

void require_held(int held, const Scene& scene) {
  if (held == 0) {
    throw Error("bench: no free vertex within " + profiles::number_text(scene.patch_radius_m) +
                " m of the top of scene " + scene.name + "; use a larger patch_radius_m");
  }
}

Subject elastic(const Scene& scene, const SolverOptions& options, std::string setting) {
  const auto object = std::make_shared<ElasticObject<float>>(scene.mesh, options);
  require_held(object->grab(scene.mesh.top_W, scene.patch_radius_m), scene);
  return {options.border_tolerance > 0.0 ? kLocal : kQuasiStatic, std::move(setting),
          [object](const Vector3d& displacement_W) {
            const Equilibrium e = object->move_to(displacement_W);
            return Answer{e.force_W, e.relative_residual, static_cast<double>(e.iterations),
                          static_cast<double>(e.vertices), e.converged && e.reached};
          }};
}

// Nothing where there is no motion to train on. The model is what the subjects of a run share.
std::shared_ptr<ReducedBench> train(const Scene& scene, const SolverBenchOptions& options) {
  return options.training_W.empty() ? nullptr
                                    : std::make_shared<ReducedBench>(scene, options.training_W);
}

Subject reduced(const std::shared_ptr<ReducedBench>& model) {
  return {kReduced, model->setting(), [model](const Vector3d& displacement_W) {
            const Equilibrium e = model->move_to(displacement_W);
            return Answer{e.force_W, e.relative_residual, static_cast<double>(e.iterations), 0.0,
                          e.converged};
          }};
}

Subject newton(const Scene& scene, double tolerance) {
  const auto object = std::make_shared<NewtonObject>(
      scene.mesh, NewtonObject::Options{.relative_tolerance = tolerance});
  require_held(object->grab(scene.mesh.top_W, scene.patch_radius_m), scene);
  const auto vertices = static_cast<double>(scene.mesh.rest_position_W.size());
  return {kNewton, tolerance_text(tolerance), [object, vertices](const Vector3d& displacement_W) {
            const NewtonObject::Answer a = object->move_to(displacement_W);
            return Answer{a.force_W, a.relative_residual, static_cast<double>(a.iterations),
                          vertices, a.converged};
          }};
}

class Motion {
 public:
  Motion(const Scene& scene, const std::vector<Vector3d>& displacements_W, double rate_Hz,
         double settling_s)
      : displacements_W_(displacements_W),
        rate_Hz_(rate_Hz),
        first_(static_cast<std::size_t>(std::lround(settling_s * rate_Hz))) {
    if (displacements_W.size() <= first_) {
      throw Error("bench: " + std::to_string(displacements_W.size()) + " positions at " +
                  profiles::number_text(rate_Hz) + " Hz; give more than the " +
                  std::to_string(first_) + " that settle");
    }
    TruthOptions truth;
    truth.contact_point_W = scene.mesh.top_W;
    truth.patch_radius_m = scene.patch_radius_m;
    std::vector<Vector3d> positions_W;
    for (const Vector3d& displacement_W : displacements_W) {
      positions_W.push_back(scene.mesh.top_W + displacement_W);
    }
    converged_W_ = simulate_truth(scene.mesh, positions_W, truth).forces_W;
    for (std::size_t tick = first_; tick < converged_W_.size(); ++tick) {
      squared_N2_ += converged_W_[tick].squaredNorm();
    }
  }

  MotionRow measure(const Subject& subject) const {
    MotionRow row{.solver = subject.name, .rate_Hz = rate_Hz_, .setting = subject.setting};
    double error_N2 = 0.0;
    double largest_N = 0.0;
    rt::Percentiles times_us;  // which tells nothing below 1/64 apart
    for (std::size_t tick = 0; tick < displacements_W_.size(); ++tick) {
      const double start_s = thread_time_s();
      const Answer answer = subject.move_to(displacements_W_[tick]);
      const double time_ms = 1e3 * (thread_time_s() - start_s);
      if (tick < first_) {
        continue;
      }
      const double error_N = (answer.force_W - converged_W_[tick]).norm();
      ++row.ticks;
      row.mean_ms += time_ms;
      times_us.add(1e3 * time_ms);
      row.max_ms = std::max(row.max_ms, time_ms);
      error_N2 += error_N * error_N;
      largest_N = std::max(largest_N, error_N);
      row.residual_mean += answer.relative_residual;
      row.iterations_mean += answer.iterations;
      row.vertices_mean += answer.vertices;
      row.unconverged += answer.converged ? 0.0 : 1.0;
    }
    const auto ticks = static_cast<double>(row.ticks);
    for (double* mean : {&row.mean_ms, &row.residual_mean, &row.iterations_mean, &row.vertices_mean,
                         &row.unconverged}) {
      *mean /= ticks;
    }
    row.median_ms = 1e-3 * times_us.at(0.5);
    row.error_percent = 100.0 * std::sqrt(error_N2 / squared_N2_);
    row.max_error_percent = 100.0 * largest_N / std::sqrt(squared_N2_ / ticks);
    return row;
  }

 private:
  std::vector<Vector3d> displacements_W_;
  double rate_Hz_;
  std::size_t first_;
  std::vector<Vector3d> converged_W_;
  double squared_N2_ = 0.0;
};

void measure_motion(const Scene& scene, const SolverBenchOptions& options,
                    SolverBenchResult& result) {
  const auto say = [&options](const std::string& text) {
    if (options.say) {
      options.say(text);
    }
  };
  const auto measure = [&](const Motion& motion, const Subject& subject) {
    say(subject.name + ", " + subject.setting);
    result.motion.push_back(motion.measure(subject));
  };
  say("converged forces at 30 Hz");
  const Motion slow(scene, options.at_30_Hz_W, 30.0, options.settling_s);
  for (const double tolerance : {1e-2, 3e-3, 1e-3, 3e-4}) {
    SolverOptions solver;
    solver.relative_tolerance = tolerance;
    measure(slow, elastic(scene, solver, tolerance_text(tolerance)));
  }
  for (const double border : {1e-2, 3e-3, 1e-3}) {
    SolverOptions solver;
    solver.border_tolerance = border;
    measure(slow, elastic(scene, solver, "border " + profiles::number_text(border)));
  }
  const std::shared_ptr<ReducedBench> model = train(scene, options);
  if (model) {
    measure(slow, reduced(model));
    say("reduced, its states");
    result.reduced.push_back(model->compare_states(options.at_30_Hz_W));
  }
  for (const double tolerance : {1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5}) {
    measure(slow, newton(scene, tolerance));
  }
  say("converged forces at 500 Hz");
  const Motion fast(scene, options.at_500_Hz_W, 500.0, options.settling_s);
  SolverOptions direct = DirectOptions{}.solver;
  measure(fast, elastic(scene, direct, "as direct"));
  direct.answer_first_below = 0.0;
  measure(fast, elastic(scene, direct, "correct, then answer"));
  for (const int whole_every : {0, 8, 16}) {
    SolverOptions solver = DirectOptions{}.solver;
    solver.border_tolerance = kFastBorder;
    solver.whole_every = whole_every;
    solver.max_iterations = whole_every == 0 ? solver.max_iterations : kWholeIterations;
    solver.most_vertices = kMostVertices;
    measure(fast, elastic(scene, solver,
                          whole_every == 0 ? "as direct"
                                           : "whole object every " + std::to_string(whole_every)));
  }
  if (model) {
    measure(fast, reduced(model));
  }
  for (const double tolerance : {1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5}) {
    measure(fast, newton(scene, tolerance));
  }
}

// Time from which on `reached` holds for all later points; of points that are solved anew each, one
// further on may have been the quicker.
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

// One point a tolerance, each from rest; of the repeats the quickest.
std::vector<StepPoint> step_points(const std::function<Subject(double tolerance)>& make,
                                   const Vector3d& displacement_W, const Vector3d& converged_W) {
  std::vector<StepPoint> points;
  for (double exponent = -0.5; exponent >= -4.51; exponent -= 0.25) {
    StepPoint point{.time_ms = kNever};
    for (int repeat = 0; repeat < kStepRepeats; ++repeat) {
      const Subject subject = make(std::pow(10.0, exponent));
      const double start_s = thread_time_s();
      const Answer answer = subject.move_to(displacement_W);
      point.time_ms = std::min(point.time_ms, 1e3 * (thread_time_s() - start_s));
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
    solver.max_step_m = kStep_m;  // linear springs bear it
    solver.relative_tolerance = tolerance;
    return elastic(scene, solver, {});
  };
  const auto plain = [&scene](double tolerance) { return newton(scene, tolerance); };
  result.step.push_back(
      step_row(kQuasiStatic, step_points(ours, displacement_W, converged_W), vertices));
  result.step.push_back(
      step_row(kNewton, step_points(plain, displacement_W, converged_W), vertices));
  for (const StepPeer& peer : options.peers) {
    if (options.say) {
      options.say("step, " + peer.name);
    }
    result.step.push_back(
        step_row(peer.name, peer.run(scene, displacement_W, converged_W), vertices));
  }
}

void find_ratios(SolverBenchResult& result) {
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
                             profiles::number_text(ours.rate_Hz) + " Hz, same force error",
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

double thread_time_s() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

SolverBenchResult bench_solvers(const Scene& scene, const SolverBenchOptions& options) {
  SolverBenchResult result{.scene = scene.name,
                           .vertices = scene.mesh.rest_position_W.size(),
                           .springs = scene.mesh.springs.size()};
  measure_motion(scene, options, result);
  measure_step(scene, options, result);
  result.dynamic = bench_dynamic(scene, options.at_30_Hz_W, 30.0, options.say);
  find_ratios(result);
  return result;
}

nlohmann::json to_json(const SolverBenchResult& result) {
  nlohmann::json json{{"scene", result.scene},
                      {"vertices", result.vertices},
                      {"springs", result.springs},
                      {"remarks", result.remarks},
                      {"motion", nlohmann::json::array()},
                      {"step", nlohmann::json::array()},
                      {"dynamic", nlohmann::json::array()},
                      {"reduced", nlohmann::json::array()},
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
                              {"unconverged", row.unconverged}});
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
  for (const SpeedRatio& ratio : result.ratios) {
    json["ratios"].push_back({{"solver", ratio.solver},
                              {"peer", ratio.peer},
                              {"at", ratio.at},
                              {"ratio", number_or_null(ratio.ratio)}});
  }
  return json;
}

}  // namespace forcegrid::simulator
