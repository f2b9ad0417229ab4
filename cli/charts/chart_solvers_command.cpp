// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_solvers_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "cli/charts/chart_support.h"
#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "cli/common/scene_option.h"
#include "cli/run/run_checks.h"
#include "evaluation/charts/solver_chart.h"
#include "evaluation/scenarios/scenarios.h"
#include "simulator/bench/solver_scaling.h"

namespace forcegrid::cli {
namespace {

constexpr std::uint64_t kSeed = 1;
constexpr double kRate_Hz = 500.0;
constexpr double kMotion_s = 1.0;
constexpr double kQuickMotion_s = 0.7;
constexpr int kQuickSize = 10'000;

// Time of an object relative to others: one step of conjugate gradients takes as long as there are
// vertices, and their number grows with the edge.
double share_of(double vertices) { return std::pow(vertices, 4.0 / 3.0); }

void print(const std::vector<simulator::SolverScalingRow>& rows) {
  std::printf("A servo cycle of %.0f Hz along the motion 'random', processor time of one thread\n",
              kRate_Hz);
  std::printf("  %-10s %9s %9s %-10s %10s %10s %10s %9s %9s %12s\n", "scene", "vertices",
              "elements", "solver", "mean", "median", "most", "touched", "error", "whole takes");
  for (const simulator::SolverScalingRow& row : rows) {
    const simulator::MotionRow& m = row.motion;
    std::printf("  %-10s %9zu %9zu %-10s %7.3f ms %7.3f ms %7.3f ms %9.0f %7.3f %%",
                row.scene.c_str(), row.vertices, row.tetrahedra, m.solver.c_str(), m.mean_ms,
                m.median_ms, m.max_ms, m.vertices_mean, m.error_percent);
    if (m.whole_mean_ms > 0.0) {
      std::printf(" %9.2f ms", m.whole_mean_ms);
    }
    std::printf("\n");
  }
}

}  // namespace

void add_chart_solvers(Command& chart, ChartSolversOptions& o, std::function<int()>& action) {
  Command& solvers = chart.add_subcommand(
      "solvers", "Cost of a servo cycle against the size of the object, for each solver");
  solvers.add_option("--out", o.out, "Folder for tables and picture")->required();
  solvers
      .add_option("--sizes", o.sizes,
                  "Approximate numbers of vertices of the blocks, 1000 to 1000000")
      ->separated_by(',')
      ->check(whole_between(1'000, 1'000'000))
      ->type_name("INT vertices")
      ->show_default();
  solvers
      .add_option("--scenes", o.scenes,
                  "Scenes beside the blocks: " + scene_help() +
                      ". The default ones are left out where their mesh is missing ('make scenes' "
                      "makes it)")
      ->separated_by(',')
      ->check(scene_check())
      ->show_default();
  solvers.add_flag("--quick", o.quick, "Blocks of up to 10000 vertices, a shorter motion");
  solvers.callback([&o, &action] { action = [&o] { return chart_solvers_command(o); }; });
}

int chart_solvers_command(const ChartSolversOptions& asked) {
  prepare_folder(asked.out);
  ProgressLine line;
  simulator::SolverScalingOptions options;
  options.block_sizes = asked.sizes;
  if (asked.quick) {
    std::erase_if(options.block_sizes, [](int size) { return size > kQuickSize; });
  }
  options.scenes = asked.scenes == ChartSolversOptions{}.scenes
                       ? simulator::scenes_at_hand(asked.scenes, line.say_function())
                       : asked.scenes;
  options.rate_Hz = kRate_Hz;
  options.displacements_W = evaluation::displacements_along_motion(kSeed, 1.0 / kRate_Hz);
  options.displacements_W.resize(std::min(
      options.displacements_W.size(), static_cast<std::size_t>(std::lround(
                                          (asked.quick ? kQuickMotion_s : kMotion_s) * kRate_Hz))));
  // The time of a step grows with the object's size; of the scenes only the number is known yet.
  const double least = options.block_sizes.empty() ? 1.0 : options.block_sizes.front();
  std::vector<double> shares(options.scenes.size(), share_of(least));
  for (const int size : options.block_sizes) {
    shares.push_back(share_of(size));
  }
  const double all = std::accumulate(shares.begin(), shares.end(), 0.0);
  std::size_t step = 0;
  double done = 0.0;
  options.say = [&](const std::string& what) {
    line.say(what);
    line.show("Measuring solvers", done / all);
    done += shares.at(step / simulator::kScalingSteps) / simulator::kScalingSteps;
    ++step;
  };
  const auto rows = simulator::bench_scaling(options);
  const auto files = evaluation::write_solver_chart(asked.out, rows, kRate_Hz);
  line.clear();
  print(rows);
  std::printf("Open %s\n", files.back().c_str());
  return 0;
}

}  // namespace forcegrid::cli
