// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/solver_bench_command.h"

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "cli/common/progress_line.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/scenarios.h"
#include "simulator/bench/bullet_peer.h"
#include "simulator/bench/solver_bench.h"

namespace forcegrid::cli {
namespace {

constexpr std::uint64_t kBenchSeed = 1;
constexpr double kSlowMotion_s = 4.0;
constexpr double kFastMotion_s = 1.5;
constexpr double kLearning_s = 20.0;
// Above this size the full solver, which checks the model, takes minutes.
constexpr std::size_t kMostVerticesLearnt = 20'000;
// The best model that the solver study found, a more accurate one and a faster one.
constexpr double kBulletRelaxations[] = {0.03, 0.10, 0.25};

std::vector<Eigen::Vector3d> motion_W(double rate_Hz, double duration_s) {
  std::vector<Eigen::Vector3d> displacements_W =
      evaluation::displacements_along_motion(kBenchSeed, 1.0 / rate_Hz);
  displacements_W.resize(std::min(displacements_W.size(),
                                  static_cast<std::size_t>(std::lround(duration_s * rate_Hz))));
  return displacements_W;
}

// Not the motion along which the model is measured.
std::vector<Eigen::Vector3d> training_W() {
  const evaluation::Trajectory motion("lissajous");
  std::vector<Eigen::Vector3d> displacements_W;
  for (double time_s = 0.0; time_s < motion.duration_s(); time_s += 1.0 / 30.0) {
    displacements_W.push_back(motion.position_W(time_s) - evaluation::first_contact_point_W());
  }
  return displacements_W;
}

std::string milliseconds_text(double time_ms) {
  if (!std::isfinite(time_ms)) {
    return "never";
  }
  char text[32];
  std::snprintf(text, sizeof text, "%.2f ms", time_ms);
  return text;
}

void print_motion(const simulator::SolverBenchResult& result) {
  std::printf(
      "\nAlong the motion 'random', processor time per tick; error: RMS of |F - F converged| in %% "
      "of "
      "RMS |F|\n  %-14s %-24s %7s %10s %10s %10s %10s %10s %10s %8s %9s\n",
      "solver", "setting", "rate", "mean", "median", "most", "error", "most", "|r|/|F|", "CG its",
      "vertices");
  for (const simulator::MotionRow& row : result.motion) {
    std::printf(
        "  %-14s %-24s %4.0f Hz %7.3f ms %7.3f ms %7.3f ms %8.4f %% %8.4f %% %10.1e %8.1f "
        "%9.0f%s\n",
        row.solver.c_str(), row.setting.c_str(), row.rate_Hz, row.mean_ms, row.median_ms,
        row.max_ms, row.error_percent, row.max_error_percent, row.residual_mean,
        row.iterations_mean, row.vertices_mean,
        row.unconverged > 0.0
            ? ("  tolerance missed in " + std::to_string(std::lround(100.0 * row.unconverged)) +
               " % of the ticks")
                  .c_str()
            : "");
  }
}

void print_dynamic(const simulator::SolverBenchResult& result) {
  if (result.dynamic.empty()) {
    return;
  }
  std::printf(
      "\nThe object in motion, solver dynamic: processor time per step along the motion 'random';\n"
      "force against the equilibrium's after the tool has rested; energy after it has let go\n"
      "  %10s %12s %12s %8s %16s %12s %14s %14s\n",
      "step", "mean", "most", "CG its", "static error", "let go", "after 0.1 s", "largest rise");
  for (const simulator::DynamicRow& row : result.dynamic) {
    std::printf("  %7.2f ms %9.3f ms %9.3f ms %8.1f %14.4f %% %9.2f mJ %12.1f %% %12.1e %%\n",
                1e3 * row.step_s, row.mean_ms, row.max_ms, row.iterations_mean,
                row.static_error_percent, 1e3 * row.released_J, row.after_100ms_percent,
                row.largest_rise_percent);
  }
}

void print_reduced(const simulator::SolverBenchResult& result) {
  if (result.reduced.empty()) {
    return;
  }
  std::printf(
      "\nThe reduced model, trained on the motion 'lissajous'; states against the full solver's at "
      "30 Hz\n  %8s %12s %8s %8s %9s %15s %13s %10s %12s\n",
      "states", "training", "modes", "springs", "memory", "trained forces", "state error", "most",
      "farthest");
  for (const simulator::ReducedRow& row : result.reduced) {
    std::printf("  %8zu %10.2f s %8d %8zu %6.0f KB %13.4f %% %11.4f %% %8.4f %% %9.1f mm\n",
                row.states, row.training_s, row.modes, row.springs,
                1e-3 * static_cast<double>(row.memory_bytes), row.training_error_percent,
                row.state_error_percent, row.max_state_error_percent, row.farthest_mm);
  }
}

void print_learning(const simulator::SolverBenchResult& result) {
  if (result.learning.empty()) {
    return;
  }
  std::printf(
      "\nThe reduced model learned along the motion 'random', against the full solver's forces\n  "
      "%8s %10s %9s %12s %10s %12s %12s %10s %14s\n",
      "answers", "rate", "by model", "their error", "most, all", "time, median", "99 %",
      "trainings", "failed checks");
  for (const simulator::LearningRow& row : result.learning) {
    std::printf(
        "  %8zu %7.0f Hz %7.1f %% %10.4f %% %8.4f %% %9.3f ms %9.3f ms %10llu %6llu of %llu\n",
        row.answers, row.rate_Hz, row.by_model_percent, row.model_error_percent,
        row.max_error_percent, row.model_median_ms, row.model_p99_ms,
        static_cast<unsigned long long>(row.trainings),
        static_cast<unsigned long long>(row.failed_checks),
        static_cast<unsigned long long>(row.checks));
  }
}

void print_step(const simulator::SolverBenchResult& result) {
  if (result.step.empty()) {
    return;
  }
  std::printf(
      "\nA step of 10 mm upwards from rest, linear springs; processor time until it stays within\n"
      "  %-24s %12s %12s %12s %12s %12s %14s %9s\n",
      "solver", "|r| 1e-2", "|r| 1e-3", "first at 1 %", "force 1 %", "force 0.1 %", "least error",
      "vertices");
  for (const simulator::StepRow& row : result.step) {
    std::printf("  %-24s %12s %12s %12s %12s %12s %12.4f %% %9.0f\n", row.solver.c_str(),
                milliseconds_text(row.to_residual_1e2_ms).c_str(),
                milliseconds_text(row.to_residual_1e3_ms).c_str(),
                milliseconds_text(row.first_error_1_ms).c_str(),
                milliseconds_text(row.to_error_1_ms).c_str(),
                milliseconds_text(row.to_error_01_ms).c_str(), row.least_error_percent,
                row.vertices);
  }
}

void print_ratios(const simulator::SolverBenchResult& result) {
  if (result.ratios.empty()) {
    return;
  }
  std::printf("\nTime of the peer's cheapest setting of at least the same accuracy, over ours\n");
  for (const simulator::SpeedRatio& ratio : result.ratios) {
    char text[32] = "no setting is as accurate";
    if (std::isfinite(ratio.ratio)) {
      std::snprintf(text, sizeof text, "%.1f", ratio.ratio);
    }
    std::printf("  %-44s %-24s %-26s %s\n", ratio.solver.c_str(), ratio.peer.c_str(),
                ratio.at.c_str(), text);
  }
}

}  // namespace

int solver_bench_command(const std::string& scene, const JsonTarget& json) {
  check_writable(json);
  simulator::SolverBenchOptions options;
  options.at_30_Hz_W = motion_W(30.0, kSlowMotion_s);
  options.at_500_Hz_W = motion_W(500.0, kFastMotion_s);
  options.training_W = training_W();
  ProgressLine line;
  WorkProgress work(line);
  options.say = [&line, &work](const std::string& what) {
    line.say("measuring: " + what);
    work.begin(what);
  };
  for (const double relaxation : kBulletRelaxations) {
    options.peers.push_back(simulator::bullet_peer(relaxation));
  }
  work.begin("Loading scene " + scene);
  const simulator::Scene made = simulator::make_scene(scene);
  const bool learns = made.mesh.rest_position_W.size() <= kMostVerticesLearnt;
  if (learns) {
    options.learning_W = motion_W(100.0, kLearning_s);
  }
  simulator::SolverBenchResult result = simulator::bench_solvers(made, options);
  work.end();
  if (!learns && result.tetrahedra == 0) {
    result.remarks.push_back("the model was not learned along the motion: more than " +
                             std::to_string(kMostVerticesLearnt) + " vertices");
  }
  if (!json.on_stdout()) {
    std::printf("%s: %zu vertices, %zu springs, %zu tetrahedra\n", result.scene.c_str(),
                result.vertices, result.springs, result.tetrahedra);
    print_motion(result);
    print_reduced(result);
    print_learning(result);
    print_step(result);
    print_dynamic(result);
    print_ratios(result);
    for (const std::string& remark : result.remarks) {
      std::printf("%s\n", remark.c_str());
    }
  }
  write_json(json, simulator::to_json(result).dump(2));
  return 0;
}

}  // namespace forcegrid::cli
