// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "cli/charts/chart_support.h"
#include "cli/common/figures.h"
#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "cli/common/tools_names.h"
#include "evaluation/charts/chart.h"
#include "evaluation/charts/chart_plan.h"
#include "evaluation/charts/chart_report.h"
#include "evaluation/charts/page_text.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/network.h"
#include "evaluation/scenarios/scenarios.h"
#include "forcegrid/methods.h"
#include "log/log.h"
#include "rt/vectors.h"
#include "simulator/mesh/vertex_masses.h"
#include "simulator/rivals/rivals.h"
#include "stability/chart.h"
#include "stability/chart_pictures.h"

namespace forcegrid::cli {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> scene_names() {
  std::vector<std::string> names;
  for (const evaluation::ChartScene& scene : evaluation::chart_scenes()) {
    names.push_back(scene.name);
  }
  return names;
}

std::vector<std::string> extra_names() {
  std::vector<std::string> names;
  for (const evaluation::NamedWalls& walls : evaluation::named_walls()) {
    names.push_back(walls.name);
  }
  for (const evaluation::NamedObjectEffect& effect : evaluation::named_object_effects()) {
    names.push_back(effect.name);
  }
  return names;
}

std::vector<std::string> rival_names() {
  std::vector<std::string> names;
  for (const simulator::Rival& rival : simulator::rivals()) {
    names.emplace_back(rival.name);
  }
  return names;
}

Check chart_scene() {
  return Check{[](const std::string& name) {
                 try {
                   evaluation::chart_scene(name);
                   return std::string();
                 } catch (const std::runtime_error& error) {
                   return std::string(error.what());
                 }
               },
               "SCENE[+EXTRA]"};
}

std::vector<std::string> condition_names() {
  std::vector<std::string> names;
  for (const evaluation::NetworkCondition& condition : evaluation::network_conditions()) {
    names.push_back(condition.name);
  }
  return names;
}

struct Selection {
  std::string scene;
  std::string trajectory;
  std::string condition;
};

Selection selection_of(const std::string& text) {
  // From the end: a scene may be the path of a file.
  const std::size_t second = text.rfind('/');
  const std::size_t first =
      second == std::string::npos || second == 0 ? std::string::npos : text.rfind('/', second - 1);
  if (first == std::string::npos) {
    throw std::runtime_error("--figures " + text +
                             ": write SCENE/TRAJECTORY/CONDITION, e.g. small/chirp/ideal");
  }
  Selection selection{text.substr(0, first), text.substr(first + 1, second - first - 1),
                      text.substr(second + 1)};
  evaluation::chart_scene(selection.scene);
  static_cast<void>(evaluation::Trajectory(selection.trajectory));
  evaluation::network_condition(selection.condition);
  return selection;
}

evaluation::ChartFigure draw(const evaluation::ChartOptions& options, const Selection& selection,
                             const std::vector<std::string>& methods) {
  const evaluation::ChartTrace played = evaluation::trace_of(
      options, selection.scene, selection.trajectory, selection.condition, methods);
  std::vector<FigureRow> rows;
  for (std::size_t i = 0; i < played.trace.servo.size(); ++i) {
    const evaluation::ServoInstant& instant = played.trace.servo[i];
    FigureRow row;
    row.time_s = instant.time_s;
    row.position_W_m = rt::to_array(instant.position_W - evaluation::first_contact_point_W());
    row.reference_W_N = rt::to_array(instant.force_W);
    for (const auto& forces_W : played.forces_W) {
      row.method_W_N.push_back(rt::to_array(forces_W[i]));
    }
    rows.push_back(std::move(row));
  }
  const std::string name = evaluation::file_name_part(selection.scene) + "-" +
                           selection.trajectory + "-" + selection.condition;
  const fs::path folder = options.out / "figures" / name;
  fs::create_directories(folder);
  write_figure_data(folder.string(), played.methods, rows);
  draw_figures(folder.string(), played.methods, rows);
  std::ifstream svg(folder / "forces.svg");
  std::ostringstream text;
  text << svg.rdbuf();
  return {selection.scene + ", " + selection.trajectory + ", " + selection.condition, text.str()};
}

void print_numbers(const evaluation::Chart& chart, const std::string& method) {
  print_goals_head(chart.numbers, "method " + method + ", scene " +
                                      (chart.numbers.empty() ? "" : chart.numbers.front().scene));
  GoalCount count;
  for (const evaluation::ChartNumber& each : chart.numbers) {
    if (count.add(each.known(), each.met())) {
      std::printf("  %-48s %9.4g %-2s  goal %-5g %-30s  %s\n", each.name.c_str(), each.measured,
                  each.unit.c_str(), each.goal,
                  evaluation::goal_verdict(each.measured, each.goal, false).words.c_str(),
                  each.worst.c_str());
    }
  }
  std::printf("%s\n", count.sentence().c_str());
}

// The methods of the chart that a closed loop can have: those that need no requests.
std::vector<std::string> methods_in_the_loop(const ChartAccuracyOptions& asked,
                                             const std::string& default_method) {
  std::vector<std::string> wanted =
      asked.methods.empty() ? std::vector<std::string>{"hold", "forcegrid"} : asked.methods;
  wanted.push_back(default_method);
  std::vector<std::string> methods;
  for (const std::string& text : wanted) {
    const evaluation::ChartMethod method = evaluation::method_of(text);
    if (!method.direct && !method.needs.requests &&
        std::find(methods.begin(), methods.end(), method.text) == methods.end()) {
      methods.push_back(method.text);
    }
  }
  return methods;
}

// The second picture of the page: up to which stiffness the methods are stable. Its cells are kept
// in a folder of their own, as those of the chart of stability.
evaluation::LeadPicture stiffness_picture(const evaluation::ChartOptions& chart,
                                          const ChartAccuracyOptions& asked) {
  stability::StabilityChartOptions options;
  options.out = chart.out / "stiffness";
  options.cache = chart.cache;
  options.quick = chart.quick;
  options.jobs = chart.jobs;
  options.seed = chart.seed;
  options.program = chart.program;
  options.cancel = chart.cancel;
  options.progress = chart.progress;
  options.default_method = chart.default_method;
  options.cells = stability::stiffness_cells(methods_in_the_loop(asked, chart.default_method));
  const stability::StabilityChart cells = stability::make_stability_chart(options);
  const fs::path svg = chart.out / "stiffness_over_delay.svg";
  stability::draw_stiffness(cells, chart.default_method, svg);
  return {"Up to which stiffness?",
          "Object " + cells.scene +
              ". Below its curve a method is stable, which does not make it accurate; exact is the "
              "object's own force in every cycle. More: forcegrid chart stability.",
          evaluation::read_text(svg)};
}

void add_accuracy(Command& chart, ChartAccuracyOptions& o, std::function<int()>& action) {
  Command& accuracy = chart.add_subcommand(
      "accuracy", "Errors and costs of force methods on objects, motions and networks");
  add_sharded_choice(accuracy, o,
                     {.quick = "The small block and a selection, within a minute",
                      .jobs = "Threads that make force tables",
                      .seed = "Of motions, noise and networks"});
  accuracy
      .add_option(
          "--scenes", o.scenes,
          "Objects (default all, and the last with everything below): " + joined(scene_names()) +
              "; any other scene of 'simulate'; harder ones, e.g. small+wall_flat: " +
              joined(extra_names()))
      ->separated_by(',')
      ->check(chart_scene());
  accuracy
      .add_option("--trajectories", o.trajectories,
                  "Motions (default all): " + joined(evaluation::chart_motions()))
      ->separated_by(',')
      ->check(one_of(evaluation::chart_motions()));
  accuracy
      .add_option("--conditions", o.conditions,
                  "Networks (default all): " + joined(condition_names()))
      ->separated_by(',')
      ->check(one_of(condition_names()));
  accuracy
      .add_option("--methods", o.methods,
                  "Methods with changes to their options, separated by ';' (default all, and "
                  "variants that matter): " +
                      joined(method_names()) +
                      ", direct; of its model alone: " + joined(rival_names()))
      ->separated_by(';');
  add_goals_for(accuracy, o.goals_for);
  accuracy
      .add_option("--figures", o.figures,
                  "The paper's figures 7 and 8 for SCENE/TRAJECTORY/CONDITION (default: chirp, "
                  "ideal, on the last scene)")
      ->separated_by(',');
  accuracy
      .add_option("--figure-methods", o.figure_methods,
                  "Methods in them, separated by ';' (default: that of 'run', forcegrid, hold)")
      ->separated_by(';');
  accuracy.add_flag("--no-stiffness-picture", o.no_stiffness_picture,
                    "Leave out the page's second picture, up to which stiffness the methods are "
                    "stable; a selection of scenes, trajectories or conditions leaves it out, too");
  accuracy.callback([&o, &action] { action = [&o] { return chart_accuracy_command(o); }; });
}

// Force tables hold one force per position, so the chart can't show objects that move.
void note_what_moves(const std::vector<std::string>& scenes) {
  for (const std::string& name : scenes) {
    const evaluation::ChartScene& scene = evaluation::chart_scene(name);
    const simulator::SpringMesh mesh = evaluation::make_mesh(scene);
    if (simulator::dynamics_of(mesh) == simulator::MeshDynamics::kDamped) {
      log::info("chart", "Note: scene " + name +
                             " moves by itself; the chart uses its equilibria, without masses and "
                             "dampers ('forcegrid run --scene " +
                             scene.object + "' judges it in motion)");
    }
  }
}

}  // namespace

void add_chart(Command& app, ChartCommandOptions& options, std::function<int()>& action) {
  Command& chart = app.add_subcommand("chart", tools_description("chart"));
  chart.require_subcommand();
  add_accuracy(chart, options.accuracy, action);
  add_chart_solvers(chart, options.solvers, action);
  add_chart_wrist(chart, options.wrist, action);
  add_chart_stability(chart, options.stability, action);
  add_chart_two_tools(chart, options.two_tools, action);
}

int chart_accuracy_command(const ChartAccuracyOptions& asked) {
  ProgressLine line;
  evaluation::ChartOptions options;
  take_common(options, asked, line);
  options.scenes = asked.scenes;
  note_what_moves(asked.scenes);
  options.trajectories = asked.trajectories;
  options.conditions = asked.conditions;
  std::vector<Selection> selections;
  for (const std::string& text : asked.figures) {
    selections.push_back(selection_of(text));
  }
  std::vector<std::string> figure_methods = asked.figure_methods;
  if (figure_methods.empty()) {
    for (const std::string& method :
         {options.default_method, std::string("forcegrid"), std::string("hold")}) {
      if (std::find(figure_methods.begin(), figure_methods.end(), method) == figure_methods.end()) {
        figure_methods.push_back(method);
      }
    }
  }

  evaluation::Chart chart = resumable([&options] { return evaluation::make_chart(options); });
  if (!options.shard.whole()) {
    return end_of_shard(asked, chart.rows.size(), chart.not_judged.size(), chart.elapsed_s, line);
  }
  if (selections.empty() && !chart.tables.empty()) {
    selections.push_back({chart.tables.back().scene, "chirp", "ideal"});
  }
  std::vector<evaluation::ChartFigure> figures;
  for (const Selection& selection : selections) {
    try {
      figures.push_back(draw(options, selection, figure_methods));
    } catch (const evaluation::ChartError& error) {
      const std::string what =
          "figure " + selection.scene + "/" + selection.trajectory + "/" + selection.condition;
      line.say("not drawn: " + what + ": " + error.what());
      chart.not_run.push_back({what, error.what()});
    }
  }
  std::vector<evaluation::LeadPicture> more;
  if (!asked.no_stiffness_picture && asked.scenes.empty() && asked.trajectories.empty() &&
      asked.conditions.empty()) {
    more.push_back(stiffness_picture(options, asked));
  }
  const std::vector<fs::path> files = evaluation::write_chart(chart, options, figures, more);
  line.clear();
  print_numbers(chart, options.default_method);
  if (!chart.not_judged.empty()) {
    std::printf("%zu rows were not judged; the page and accuracy.csv have the reasons\n",
                chart.not_judged.size());
  }
  std::printf("%zu rows (%zu of them from an earlier call) in %s; open %s\n", chart.rows.size(),
              chart.rows_kept, time_text(chart.elapsed_s).c_str(), files.back().c_str());
  return 0;
}

}  // namespace forcegrid::cli
