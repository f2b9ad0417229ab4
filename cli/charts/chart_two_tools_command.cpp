// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_two_tools_command.h"

#include <algorithm>
#include <cstdio>

#include "cli/common/number_check.h"
#include "cli/common/option_values.h"
#include "evaluation/charts/page_text.h"
#include "evaluation/charts/pair_chart.h"
#include "evaluation/motions/pair_motions.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "stability/pair_limits.h"

namespace forcegrid::cli {
namespace {

constexpr double kQuickSeconds = 5.0;
constexpr double kLeastLimit = 0.95;  // goal: of the stiffness that exact rendering has
constexpr char kGoalsObject[] = "block";
constexpr char kErrors[] = "errors";
constexpr char kStability[] = "stability";

bool has(const ChartTwoToolsOptions& asked, const std::string& part) {
  return asked.parts.empty() ||
         std::find(asked.parts.begin(), asked.parts.end(), part) != asked.parts.end();
}

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
  options.noise_N = 1e-3 * asked.noise_mN;
  options.stiffness = asked.stiffness;
  return options;
}

void chart_errors(const evaluation::PairChartOptions& options, ProgressLine& line) {
  const evaluation::PairChart chart =
      resumable([&options] { return evaluation::make_pair_chart(options); });
  const auto files = evaluation::write_pair_chart(chart, options);
  line.clear();
  print_means(chart);
  print_numbers(chart, options.goals_for);
  std::printf("%zu rows; open %s; the traces are in %s\n", chart.rows.size(), files.back().c_str(),
              (options.out / "traces").c_str());
}

void chart_stability(const evaluation::PairChartOptions& options, const ChartTwoToolsOptions& asked,
                     ProgressLine& line) {
  stability::PairLimitOptions limits;
  limits.objects = asked.objects;
  if (limits.objects.empty()) {
    limits.objects = {stability::kSprings};
    if (!asked.quick) {
      limits.objects.push_back(kGoalsObject);
    }
  }
  limits.stiffness = options.stiffness;
  limits.methods =
      options.methods.empty() ? stability::default_pair_limit_methods() : options.methods;
  if (std::find(limits.methods.begin(), limits.methods.end(), options.goals_for) ==
      limits.methods.end()) {
    limits.methods.push_back(options.goals_for);
  }
  limits.quick = asked.quick;
  limits.jobs = options.jobs;
  limits.cancel = options.cancel;
  limits.progress = [&options](double done, double remaining_s) {
    options.progress("Searching for stiffness limits", done, remaining_s);
  };
  const auto rows = stability::pair_limits(limits);
  const auto files = stability::write_pair_limits(options.out, rows);
  line.clear();
  std::printf("Largest stable stiffness relative to exact rendering, least of all loops:\n");
  for (const std::string& object : limits.objects) {
    for (const std::string& method : limits.methods) {
      std::printf("  %-10s %-24s %9.3g\n", object.c_str(), method.c_str(),
                  stability::least_relative_limit(rows, object, method));
    }
  }
  const std::string& goals_of = limits.objects.back();
  const double least = stability::least_relative_limit(rows, goals_of, options.goals_for);
  std::printf("Goal, method %s on %s: at least %g, %s\n%zu rows; open %s\n",
              options.goals_for.c_str(), goals_of.c_str(), kLeastLimit,
              evaluation::goal_verdict(least, kLeastLimit, true).words.c_str(), rows.size(),
              files.back().c_str());
}

}  // namespace

void add_chart_two_tools(Command& chart, ChartTwoToolsOptions& o, std::function<int()>& action) {
  Command& command = chart.add_subcommand(
      "two-tools", "Errors, costs and stability of force methods for two tools on one object");
  add_chart_choice(command, o,
                   {.quick = "The small block alone, motions of 5 s, one hand and servo rate",
                    .jobs = "Threads that solve traces and search limits",
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
      .add_option(
          "--methods", o.methods,
          "Methods with changes to their options, separated by ';' (default: " +
              joined(evaluation::default_pair_chart_methods()) +
              "; in the part stability: " + joined(stability::default_pair_limit_methods()) +
              "). Over both tools: " + joined(pair_method_names()) +
              "; one for each tool: " + joined(method_names()))
      ->separated_by(';');
  command
      .add_option(
          "--parts", o.parts,
          "Parts of the chart (default all): errors on traces, stability in the closed loop "
          "of two hands")
      ->separated_by(',')
      ->check(one_of({kErrors, kStability}));
  command
      .add_option("--objects", o.objects,
                  "Objects of the closed loop (default springs, block; the goal is of the last "
                  "one): 'springs', in closed form, or scenes as for --scenes, solved in every "
                  "cycle")
      ->separated_by(',');
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
  command
      .add_option("--noise-mN", o.noise_mN,
                  "Standard deviation of white noise on each force of a sample")
      ->check(between(0.0, 1000.0))
      ->type_name("FLOAT mN")
      ->show_default();
  command.add_flag("--stiffness", o.stiffness,
                   "Samples carry dF_i/dP_j, how each force changes with each tool's position");
  command.callback([&o, &action] { action = [&o] { return chart_two_tools_command(o); }; });
}

int chart_two_tools_command(const ChartTwoToolsOptions& asked) {
  ProgressLine line;
  const evaluation::PairChartOptions options = options_of(asked, line);
  if (has(asked, kErrors)) {
    chart_errors(options, line);
  }
  if (has(asked, kStability)) {
    chart_stability(options, asked, line);
  }
  return 0;
}

}  // namespace forcegrid::cli
