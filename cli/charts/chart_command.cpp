// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_command.h"

#include <CLI/CLI.hpp>
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
#include "evaluation/chart.h"
#include "evaluation/chart_report.h"
#include "evaluation/network.h"
#include "evaluation/scenarios.h"
#include "evaluation/trajectories.h"
#include "forcegrid/methods.h"
#include "simulator/mesh/vertex_masses.h"

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

CLI::Validator chart_scene() {
  return CLI::Validator(
      [](std::string& name) {
        try {
          evaluation::chart_scene(name);
          return std::string();
        } catch (const std::runtime_error& error) {
          return std::string(error.what());
        }
      },
      "SCENE[+EXTRA]");
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
  const std::size_t first = text.find('/');
  const std::size_t second = first == std::string::npos ? first : text.find('/', first + 1);
  if (second == std::string::npos) {
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
  const auto triple = [](const Eigen::Vector3d& v) { return Triple{v.x(), v.y(), v.z()}; };
  for (std::size_t i = 0; i < played.trace.servo.size(); ++i) {
    const evaluation::ServoInstant& instant = played.trace.servo[i];
    FigureRow row;
    row.time_s = instant.time_s;
    row.position_W_m = triple(instant.position_W - evaluation::first_contact_point_W());
    row.reference_W_N = triple(instant.force_W);
    for (const auto& forces_W : played.forces_W) {
      row.method_W_N.push_back(triple(forces_W[i]));
    }
    rows.push_back(std::move(row));
  }
  const std::string name = selection.scene + "-" + selection.trajectory + "-" + selection.condition;
  const fs::path folder = options.out / "figures" / name;
  fs::create_directories(folder);
  write_figures(folder.string(), played.methods, rows);
  std::ifstream svg(folder / "forces.svg");
  std::ostringstream text;
  text << svg.rdbuf();
  return {selection.scene + ", " + selection.trajectory + ", " + selection.condition, text.str()};
}

void print_numbers(const evaluation::Chart& chart, const std::string& method) {
  std::printf("Goals, method %s, scene %s:\n", method.c_str(),
              chart.numbers.empty() ? "none" : chart.numbers.front().scene.c_str());
  for (const evaluation::ChartNumber& each : chart.numbers) {
    if (each.known()) {
      std::printf("  %-48s %9.4g %-2s  goal %g  %-6s  %s\n", each.name.c_str(), each.measured,
                  each.unit.c_str(), each.goal, each.met() ? "met" : "MISSED", each.worst.c_str());
    } else {
      std::printf("  %-48s not in this selection\n", each.name.c_str());
    }
  }
}

void add_accuracy(CLI::App& chart, ChartAccuracyOptions& o, std::function<int()>& action) {
  CLI::App& accuracy = *chart.add_subcommand(
      "accuracy", "Errors and costs of force methods on objects, motions and networks");
  add_chart_choice(accuracy, o,
                   {.quick = "The small block and a selection, within a minute",
                    .jobs = "Threads that make force tables",
                    .seed = "Of motions, noise and networks"});
  accuracy
      .add_option(
          "--scenes", o.scenes,
          "Objects (default all, and the last with everything below): " + joined(scene_names()) +
              "; any other scene of 'simulate'; harder ones, e.g. small+wall_flat: " +
              joined(extra_names()))
      ->delimiter(',')
      ->check(chart_scene());
  accuracy
      .add_option("--trajectories", o.trajectories,
                  "Motions (default all): " + joined(evaluation::chart_motions()))
      ->delimiter(',')
      ->check(CLI::IsMember(evaluation::chart_motions()));
  accuracy
      .add_option("--conditions", o.conditions,
                  "Networks (default all): " + joined(condition_names()))
      ->delimiter(',')
      ->check(CLI::IsMember(condition_names()));
  accuracy
      .add_option("--methods", o.methods,
                  "Methods with changes to their options, separated by ';' (default all, and "
                  "variants that matter): " +
                      joined(method_names()) + ", direct")
      ->delimiter(';');
  add_goals_for(accuracy, o.goals_for);
  accuracy
      .add_option("--figures", o.figures,
                  "The paper's figures 7 and 8 for SCENE/TRAJECTORY/CONDITION (default: chirp, "
                  "ideal, on the last scene)")
      ->delimiter(',');
  accuracy
      .add_option("--figure-methods", o.figure_methods,
                  "Methods in them, separated by ';' (default: that of 'run', forcegrid, hold)")
      ->delimiter(';');
  accuracy.callback([&o, &action] { action = [&o] { return chart_accuracy_command(o); }; });
}

// Force tables hold one force per position, so the chart can't show objects that move.
void note_what_moves(const std::vector<std::string>& scenes) {
  for (const std::string& name : scenes) {
    const evaluation::ChartScene& scene = evaluation::chart_scene(name);
    const simulator::SpringMesh mesh = evaluation::make_mesh(scene);
    if (simulator::dynamics_of(mesh) == simulator::MeshDynamics::kDamped) {
      std::fprintf(stderr,
                   "Note: scene %s moves by itself; the chart uses its equilibria, without masses "
                   "and dampers ('forcegrid run --scene %s' judges it in motion)\n",
                   name.c_str(), scene.object.c_str());
    }
  }
}

}  // namespace

void add_chart(CLI::App& app, ChartCommandOptions& options, std::function<int()>& action) {
  CLI::App& chart = *app.add_subcommand("chart", "Chart force methods against each other");
  chart.require_subcommand(1);
  add_accuracy(chart, options.accuracy, action);
  add_chart_solvers(chart, options.solvers, action);
  add_chart_stability(chart, options.stability, action);
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

  const evaluation::Chart chart = evaluation::make_chart(options);
  if (selections.empty() && !chart.tables.empty()) {
    selections.push_back({chart.tables.back().scene, "chirp", "ideal"});
  }
  std::vector<evaluation::ChartFigure> figures;
  for (const Selection& selection : selections) {
    figures.push_back(draw(options, selection, figure_methods));
  }
  const std::vector<fs::path> files = evaluation::write_chart(chart, options, figures);
  line.clear();
  print_numbers(chart, options.default_method);
  std::printf("%zu rows (%zu of them from an earlier call) in %s; open %s\n", chart.rows.size(),
              chart.rows_kept, time_text(chart.elapsed_s).c_str(), files.back().c_str());
  return 0;
}

}  // namespace forcegrid::cli
