// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_two_tools_command.h"

#include <cstdio>

#include "cli/common/number_check.h"
#include "cli/common/option_values.h"
#include "evaluation/page_text.h"
#include "evaluation/pair_chart.h"
#include "evaluation/pair_motions.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"

namespace forcegrid::cli {
namespace {

constexpr double kQuickSeconds = 5.0;

void print_means(const evaluation::PairChart& chart) {
  std::printf("Error after 1 s, geometric mean over the pairs of motions:\n");
  std::string before;
  for (const evaluation::PairChartRow& row : chart.rows) {
    // A scene's first pair has every method once.
    if (row.pair != chart.rows.front().pair) {
      continue;
    }
    std::printf("  %-10s %-24s %9.3g %%\n", row.scene == before ? "" : row.scene.c_str(),
                row.method.c_str(),
                evaluation::geometric_mean_percent(chart, row.scene, row.method));
    before = row.scene;
  }
}

void print_numbers(const evaluation::PairChart& chart, const std::string& method) {
  print_goals_head(chart.numbers, "method " + method);
  GoalCount count;
  for (const evaluation::PairChartNumber& each : chart.numbers) {
    if (count.add(each.known(), each.met())) {
      std::printf("  %-76s %9.4g %-2s  goal %-6.3g %-26s  %s\n", each.name.c_str(), each.measured,
                  each.unit.c_str(), each.goal,
                  evaluation::goal_verdict(each.measured, each.goal, false).words.c_str(),
                  each.worst.c_str());
    }
  }
  std::printf("%s\n", count.sentence().c_str());
}

evaluation::PairChartOptions options_of(const ChartTwoToolsOptions& asked, ProgressLine& line) {
  evaluation::PairChartOptions options;
  take_choice(options, asked, line);
  if (!asked.scenes.empty()) {
    options.scenes = asked.scenes;
  } else if (asked.quick) {
    options.scenes = {"small"};
  }
  options.pairs = asked.pairs;
  options.methods = asked.methods;
  if (!asked.goals_for.empty()) {
    options.goals_for = asked.goals_for;
  }
  options.seconds = asked.quick ? kQuickSeconds : asked.seconds;
  options.delay_s = 1e-3 * asked.delay_ms;
  return options;
}

}  // namespace

void add_chart_two_tools(Command& chart, ChartTwoToolsOptions& o, std::function<int()>& action) {
  Command& command = chart.add_subcommand(
      "two-tools", "Errors and costs of force methods for two tools on one object");
  add_chart_choice(command, o,
                   {.quick = "The small block alone, motions of 5 s",
                    .jobs = "Threads that solve traces",
                    .cached = "solved traces",
                    .seed = "Of random motions"});
  command
      .add_option("--scenes", o.scenes,
                  "Objects (default small, block; the goals are of the last one): scenes of "
                  "'simulate' whose top is 75 mm wide")
      ->separated_by(',');
  command
      .add_option("--pairs", o.pairs,
                  "Pairs of motions (default all): " + joined(evaluation::pair_motion_names()))
      ->separated_by(',')
      ->check(one_of(evaluation::pair_motion_names()));
  command
      .add_option("--methods", o.methods,
                  "Methods with changes to their options, separated by ';' (default: " +
                      joined(evaluation::default_pair_chart_methods()) +
                      "). Over both tools: " + joined(pair_method_names()) +
                      "; one for each tool: " + joined(method_names()))
      ->separated_by(';');
  command.add_option("--goals-for", o.goals_for,
                     "Method that is held against the goals (default auto-6d)");
  command.add_option("--seconds", o.seconds, "Length of each trace")
      ->check(between(1.1, evaluation::PairMotion::kLongest_s))
      ->type_name("FLOAT s")
      ->show_default();
  command
      .add_option("--delay-ms", o.delay_ms,
                  "Delay of each answer beyond the simulator's own period of 33 ms")
      ->check(between(0.0, 1000.0))
      ->type_name("FLOAT ms")
      ->show_default();
  command.callback([&o, &action] { action = [&o] { return chart_two_tools_command(o); }; });
}

int chart_two_tools_command(const ChartTwoToolsOptions& asked) {
  ProgressLine line;
  const evaluation::PairChartOptions options = options_of(asked, line);
  const evaluation::PairChart chart =
      resumable([&options] { return evaluation::make_pair_chart(options); });
  const auto files = evaluation::write_pair_chart(chart, options);
  line.clear();
  print_means(chart);
  print_numbers(chart, options.goals_for);
  std::printf("%zu rows; open %s; the traces are in %s\n", chart.rows.size(), files.back().c_str(),
              (options.out / "traces").c_str());
  return 0;
}

}  // namespace forcegrid::cli
