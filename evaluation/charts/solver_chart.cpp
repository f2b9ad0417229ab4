// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/solver_chart.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <system_error>

#include "evaluation/files/gnuplot.h"
#include "evaluation/files/text_file.h"
#include "evaluation/objects/force_table.h"

namespace forcegrid::evaluation {
namespace {

namespace fs = std::filesystem;
using simulator::SolverScalingRow;

struct Series {
  const char* solver;
  const char* colour;
  int point;
};
constexpr std::array<Series, 3> kSeries{
    {{"whole", "#888888", 5}, {"local", "#d95f02", 9}, {"two_rates", "#1b6ca8", 7}}};

void write_csv(const fs::path& file, const std::vector<SolverScalingRow>& rows) {
  TextWriter out(file.string());
  out.write(
      "scene,vertices,springs,tetrahedra,solver,cycles,time_mean_ms,time_median_ms,time_max_ms,"
      "vertices_touched,error_rms_percent,error_max_percent,iterations_mean,whole_solution_ms\n");
  for (const SolverScalingRow& row : rows) {
    const simulator::MotionRow& m = row.motion;
    std::string text = row.scene + "," + std::to_string(row.vertices) + "," +
                       std::to_string(row.springs) + "," + std::to_string(row.tetrahedra) + "," +
                       m.solver + "," + std::to_string(m.ticks);
    for (const double value : {m.mean_ms, m.median_ms, m.max_ms, m.vertices_mean, m.error_percent,
                               m.max_error_percent, m.iterations_mean, m.whole_mean_ms}) {
      text += ',';
      append_number(text, value);
    }
    out.write(text + "\n");
  }
  out.finish();
}

// Columns: vertices, time mean, time most, touched, error.
std::string data_block(const std::string& name, const std::vector<SolverScalingRow>& rows,
                       const std::string& solver, bool block) {
  std::vector<SolverScalingRow> chosen;
  std::copy_if(
      rows.begin(), rows.end(), std::back_inserter(chosen),
      [&](const SolverScalingRow& r) { return r.motion.solver == solver && r.block == block; });
  std::sort(chosen.begin(), chosen.end(), [](const SolverScalingRow& a, const SolverScalingRow& b) {
    return a.vertices < b.vertices;
  });
  std::ostringstream text;
  text << '$' << name << " << EOD\n";
  for (const SolverScalingRow& row : chosen) {
    text << row.vertices << ' ' << row.motion.mean_ms << ' ' << row.motion.max_ms << ' '
         << row.motion.vertices_mean << ' ' << row.motion.error_percent << '\n';
  }
  text << "EOD\n";
  return text.str();
}

std::string panel(const std::vector<SolverScalingRow>& rows, const char* axis, int column,
                  bool with_most) {
  std::ostringstream plot;
  plot << "set ylabel " << quoted(axis) << "\nplot ";
  std::string separator;
  for (const Series& series : kSeries) {
    for (const bool block : {true, false}) {
      if (std::none_of(rows.begin(), rows.end(), [&](const SolverScalingRow& r) {
            return r.motion.solver == series.solver && r.block == block;
          })) {
        continue;
      }
      const std::string data = std::string("$") + series.solver + (block ? "" : "_other");
      const int point = block ? series.point : series.point - 1;  // hollow
      const std::string look = std::string(" pt ") + std::to_string(point) + " ps 1 lw 2 lc rgb " +
                               quoted(series.colour);
      plot << separator << data << " using 1:" << column << " with "
           << (block ? "linespoints" : "points") << look << " title "
           << quoted(std::string(series.solver) + (block ? ", block" : ", other scenes"));
      if (with_most) {
        plot << ", " << data << " using 1:2:(0):($3-$2) with vectors nohead lw 1 lc rgb "
             << quoted(series.colour) << " notitle";
      }
      separator = ", ";
    }
  }
  return plot.str() + '\n';
}

void draw(const fs::path& file, const std::vector<SolverScalingRow>& rows, double rate_Hz) {
  const auto [fewest, most] = std::minmax_element(
      rows.begin(), rows.end(),
      [](const SolverScalingRow& a, const SolverScalingRow& b) { return a.vertices < b.vertices; });
  std::ostringstream script;
  script << "set terminal svg size 1320,460 background '#ffffff' font 'sans,12'\nset output "
         << quoted(file.string()) << '\n';
  for (const Series& series : kSeries) {
    script << data_block(series.solver, rows, series.solver, true)
           << data_block(std::string(series.solver) + "_other", rows, series.solver, false);
  }
  script << "set multiplot layout 1,3\nset logscale xy\nset grid lt 1 lw 0.5 lc rgb '#dddddd'\n"
            "set border 3\nset xtics nomirror\nset ytics nomirror\nset format x '10^{%T}'\n"
            "set xlabel 'vertices of the object'\nset xrange ["
         << 0.5 * static_cast<double>(fewest->vertices) << ':'
         << 2.0 * static_cast<double>(most->vertices)
         << "]\nset key top left samplen 2 noenhanced\nset label 1 'a servo cycle' at graph 0.03, "
            "first "
         << 1e3 / rate_Hz << " left offset 0,0.5 tc rgb '#555555'\nset arrow 1 from graph 0, first "
         << 1e3 / rate_Hz << " to graph 1, first " << 1e3 / rate_Hz
         << " nohead dt 2 lc rgb '#555555'\n"
         << panel(rows, "servo time per cycle / ms: mean, line to the longest", 2, true)
         << "unset label 1\nunset arrow 1\nunset key\n"
         << panel(rows, "vertices touched per cycle, mean", 4, false)
         << panel(rows, "RMS force error / % of RMS force", 5, false) << "unset multiplot\n";
  run_gnuplot(script.str(), file);
}

}  // namespace

nlohmann::ordered_json to_json(const std::vector<SolverScalingRow>& rows, double rate_Hz) {
  nlohmann::ordered_json json{{"rate_Hz", rate_Hz}, {"rows", nlohmann::ordered_json::array()}};
  for (const SolverScalingRow& row : rows) {
    const simulator::MotionRow& m = row.motion;
    json["rows"].push_back({{"scene", row.scene},
                            {"vertices", row.vertices},
                            {"springs", row.springs},
                            {"tetrahedra", row.tetrahedra},
                            {"solver", m.solver},
                            {"cycles", m.ticks},
                            {"time_mean_ms", m.mean_ms},
                            {"time_median_ms", m.median_ms},
                            {"time_max_ms", m.max_ms},
                            {"vertices_touched", m.vertices_mean},
                            {"error_rms_percent", m.error_percent},
                            {"error_max_percent", m.max_error_percent},
                            {"iterations_mean", m.iterations_mean},
                            {"whole_solution_ms", m.whole_mean_ms}});
  }
  return json;
}

std::vector<fs::path> write_solver_chart(const fs::path& folder,
                                         const std::vector<SolverScalingRow>& rows,
                                         double rate_Hz) {
  if (rows.empty()) {
    throw ChartError("chart: no object was measured; give --sizes or --scenes");
  }
  std::error_code problem;
  fs::create_directories(folder, problem);
  if (problem) {
    throw ChartError("chart: " + folder.string() + " can't be made: " + problem.message() +
                     "; choose another folder with --out");
  }
  const fs::path json = folder / "solvers.json";
  TextWriter out(json.string());
  out.write(to_json(rows, rate_Hz).dump(2) + "\n");
  out.finish();
  const fs::path csv = folder / "solvers.csv";
  write_csv(csv, rows);
  const fs::path svg = folder / "solvers.svg";
  draw(svg, rows, rate_Hz);
  return {json, csv, svg};
}

}  // namespace forcegrid::evaluation
