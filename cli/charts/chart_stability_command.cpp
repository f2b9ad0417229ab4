// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_stability_command.h"

#include <cstdio>
#include <filesystem>

#include "cli/charts/chart_support.h"
#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "evaluation/charts/page_text.h"
#include "log/log.h"
#include "stability/chart.h"
#include "stability/chart_report.h"

namespace forcegrid::cli {
namespace {

void print_numbers(const stability::StabilityChart& chart, const std::string& method) {
  print_goals_head(chart.numbers, "method " + method + ", object " + chart.scene);
  GoalCount count;
  for (const stability::StabilityNumber& each : chart.numbers) {
    if (count.add(each.known(), each.met())) {
      std::printf("  %-78s %9.4g %-6s goal %s %-5g %-30s  %s\n", each.name.c_str(), each.measured,
                  each.unit.c_str(), each.at_least ? ">=" : "<=", each.goal,
                  evaluation::goal_verdict(each.measured, each.goal, each.at_least).words.c_str(),
                  each.worst.c_str());
    }
  }
  std::printf("%s\n", count.sentence().c_str());
}

void print_scenes(const stability::StabilityChart& chart, const std::string& method) {
  std::printf("Scenes, force error at 200 N/m in the closed loop:\n");
  for (const stability::SceneVerdict& verdict : stability::scene_verdicts(chart)) {
    for (const auto& each : verdict.methods) {
      if (each.method == method) {
        std::printf("  %-16s %-14s %7.3g %% %-12s best: %s\n", verdict.scene.c_str(),
                    method.c_str(), each.closed_loop_error_percent, to_string(each.behaviour),
                    verdict.best.empty() ? "none is stable" : verdict.best.c_str());
      }
    }
  }
}

void print_sweep(const stability::StabilityChart& chart) {
  if (chart.swept.empty()) {
    return;
  }
  std::printf("Fault sweep, %zu runs: went on / ended, force above the limit, over 1 mJ after it\n",
              chart.sweep.size());
  for (const stability::SweepLine& line : chart.swept) {
    std::printf("  %-19s %-30s %4d / %-4d %4d %4d   most %.2g mJ, %.2g N\n", line.device.c_str(),
                to_string(line.fault), line.survivors, line.runs - line.survivors,
                line.force_above_limit, line.energy_after_fault, 1e3 * line.most_energy_J,
                line.largest_force_N);
  }
}

}  // namespace

void add_chart_stability(Command& chart, ChartStabilityOptions& o, std::function<int()>& action) {
  Command& stability = chart.add_subcommand(
      "stability", "Stability of force methods in the closed loop of device, hand and servo");
  add_sharded_choice(stability, o,
                     {.quick = "The small block and fewer cells, within five minutes",
                      .seed = "Of noise, loss and motions"});
  stability
      .add_option("--methods", o.methods,
                  "Methods with changes to their options, separated by ';' (default: " +
                      joined(stability::chart_methods()) + ")")
      ->separated_by(';');
  stability
      .add_option("--parts", o.parts,
                  "Parts of the chart (default all): " + joined(stability::chart_parts()))
      ->separated_by(',')
      ->check(one_of(stability::chart_parts()));
  std::vector<std::string> hands;
  for (const stability::Hand& hand : stability::hands()) {
    hands.push_back(hand.name);
  }
  stability.add_option("--hands", o.hands, "Hands (default all): " + joined(hands))
      ->separated_by(',')
      ->check(one_of(hands));
  add_goals_for(stability, o.goals_for);
  stability.callback([&o, &action] { action = [&o] { return chart_stability_command(o); }; });
}

int chart_stability_command(const ChartStabilityOptions& asked) {
  ProgressLine line;
  stability::StabilityChartOptions options;
  take_common(options, asked, line);
  options.parts = asked.parts;
  options.hands = asked.hands;
  const stability::StabilityChart chart =
      resumable([&options] { return stability::make_stability_chart(options); });
  if (!options.shard.whole()) {
    return end_of_shard(asked, chart.rows.size(), chart.not_judged.size(), chart.elapsed_s, line);
  }
  const auto files = stability::write_stability_chart(chart, options);
  line.clear();
  print_numbers(chart, options.default_method);
  print_scenes(chart, options.default_method);
  print_sweep(chart);
  for (const stability::NotJudgedCell& each : chart.not_judged) {
    log::warn("stability", "not judged: " + each.cell.text() + ": " + each.reason);
  }
  std::printf("%zu cells (%zu of them from an earlier call) in %s; open %s\n", chart.rows.size(),
              chart.rows_kept, time_text(chart.elapsed_s).c_str(), files.back().c_str());
  return 0;
}

}  // namespace forcegrid::cli
