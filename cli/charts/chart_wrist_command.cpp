// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_wrist_command.h"

#include <cstdio>

#include "cli/charts/chart_support.h"
#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "cli/common/scene_option.h"
#include "evaluation/charts/torque_chart.h"

namespace forcegrid::cli {
namespace {

constexpr double kQuick_s = 2.0;

void print(const evaluation::TorqueChartOptions& options,
           const std::vector<evaluation::TorqueRow>& rows) {
  std::printf("A twisting grasp on %s: RMS torque error after 1 s, in %% of the RMS torque\n",
              options.scene.c_str());
  std::printf("  %-8s %11s %12s", "motion", "torque RMS", "force error");
  for (const evaluation::TorqueWay way : evaluation::kTorqueWays) {
    std::printf(" %11s", evaluation::to_string(way));
  }
  std::printf("\n");
  for (const evaluation::TorqueRow& row : rows) {
    std::printf("  %-8s %7.2f mNm %10.2f %%", row.motion.c_str(), 1e3 * row.torque_rms_Nm,
                row.force_error_percent);
    for (const double percent : row.rms_error_percent) {
      std::printf(" %9.2f %%", percent);
    }
    std::printf("\n");
  }
}

}  // namespace

void add_chart_wrist(Command& chart, ChartWristOptions& o, std::function<int()>& action) {
  Command& wrist = chart.add_subcommand(
      "wrist", "Torque of a twisting grasp, rendered from the simulator's samples in five ways");
  wrist.add_option("--out", o.out, "Folder for tables and picture")->required();
  wrist.add_option("--scene", o.scene, "What is grasped: " + scene_help())
      ->check(scene_check())
      ->show_default();
  wrist.add_option("--motions", o.motions, "Motions of the hand, see docs/turning.md")
      ->separated_by(',')
      ->check(one_of(evaluation::twist_motion_names()))
      ->show_default();
  wrist.add_option("--method", o.method, "Force method that renders the force")->show_default();
  wrist.add_option("--simulator-rate", o.simulator_rate_Hz, "Samples per second")
      ->check(between(1.0, 500.0))
      ->type_name("FLOAT Hz")
      ->show_default();
  wrist.add_option("--seed", o.seed, "Of the motion 'random'")
      ->check(seed_number())
      ->show_default();
  wrist.add_flag("--quick", o.quick, "2 s of each motion instead of 6");
  wrist.callback([&o, &action] { action = [&o] { return chart_wrist_command(o); }; });
}

int chart_wrist_command(const ChartWristOptions& asked) {
  prepare_folder(asked.out);
  ProgressLine line;
  evaluation::TorqueChartOptions options;
  options.scene = asked.scene;
  options.motions = asked.motions;
  options.method = asked.method;
  options.simulator_rate_Hz = asked.simulator_rate_Hz;
  options.seed = asked.seed;
  if (asked.quick) {
    options.seconds = kQuick_s;
  }
  options.progress = [&line](double done) { line.show("Twisting", done); };
  const auto rows = evaluation::measure_torques(options);
  const auto files = evaluation::write_torque_chart(asked.out, options, rows);
  line.clear();
  print(options, rows);
  std::printf("Open %s\n", files.back().c_str());
  return 0;
}

}  // namespace forcegrid::cli
