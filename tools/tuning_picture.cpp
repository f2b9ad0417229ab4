// SPDX-License-Identifier: Apache-2.0
#include "tools/tuning_picture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <limits>
#include <ostream>
#include <stdexcept>

#include "evaluation/files/gnuplot.h"
#include "text/output_file.h"

namespace forcegrid::tools {
namespace {

using Value = double (*)(const TuningRow&);

struct Panel {
  const char* x_title;
  const char* y_title;
  const char* scales;  ///< gnuplot's, e.g. "xy" for logarithmic ones
  Value x;
  Value y_on_path;  ///< null: only values measured in the loop are drawn
  Value y_in_loop;
  const char* style;  ///< gnuplot's, for values on the path
  bool over_budgets;  ///< for methods with a grid, at one rate; otherwise with the largest budget
};

double rate_Hz(const TuningRow& row) { return row.rate_Hz; }
double budget(const TuningRow& row) { return row.fill_budget; }
double cost_percent(const TuningRow& row) { return row.method_percent(); }
double path_error(const TuningRow& row) { return row.path_error_percent; }
double error(const TuningRow& row) { return row.error_percent; }
double missed(const TuningRow& row) { return row.missed_percent; }

constexpr Panel kPanels[] = {
    {"rate / Hz", "error / %", "y", rate_Hz, path_error, error, "linespoints", false},
    {"rate / Hz", "deadlines missed / %", "", rate_Hz, nullptr, missed, "points", false},
    {"processor time of the method / %", "error / %", "xy", cost_percent, path_error, error,
     "points", false},
    {"fill budget / vertices per cycle", "error / %", "xy", budget, path_error, error,
     "linespoints", true}};

// Okabe and Ito's colours, which most people can distinguish; then the same with other marks.
constexpr const char* kColours[] = {"#000000", "#E69F00", "#56B4E9", "#009E73",
                                    "#F0E442", "#0072B2", "#CC79A7", "#999999"};
constexpr const char* kChosenColour = "#D55E00";

std::vector<std::string> distinct_methods(const std::vector<TuningRow>& rows) {
  std::vector<std::string> methods;
  for (const TuningRow& row : rows) {
    if (std::find(methods.begin(), methods.end(), row.method) == methods.end()) {
      methods.push_back(row.method);
    }
  }
  return methods;
}

}  // namespace

std::string write_tuning_csv(const std::string& folder, const std::vector<TuningRow>& rows,
                             const TuningChoice& choice) {
  std::string file = folder + "/tuning.csv";
  text::OutputFile output(file);
  std::ostream& stream = output.stream();
  stream << "method,rate_Hz,fill_budget,path_error_percent,method_us,method_percent,"
            "method_at_timer_floor,stability_margin,measured,error_percent,missed_percent,period_"
            "p99_us,compute_p50_us,"
            "compute_p99_us,backlog_percent,chosen\n";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const TuningRow& r = rows[i];
    stream << '"' << r.method << "\"," << r.rate_Hz << ',' << r.fill_budget << ','
           << r.path_error_percent << ',' << r.method_us << ',' << r.method_percent() << ','
           << (r.at_timer_floor() ? 1 : 0) << ',' << r.stability_margin << ','
           << (r.measured ? 1 : 0);
    for (const double value : {r.error_percent, r.missed_percent, r.period_p99_us, r.compute_p50_us,
                               r.compute_p99_us, r.backlog_percent}) {
      stream << ',' << (r.measured ? value : std::nan(""));
    }
    stream << ',' << (choice.chosen == i ? 1 : 0) << '\n';
  }
  output.finish();
  return file;
}

namespace {

using Points = std::vector<std::pair<double, double>>;

// The budgets are drawn at the rate of the chosen setting, or the lowest.
double rate_of_budgets_Hz(const std::vector<TuningRow>& rows, const TuningChoice& choice) {
  if (choice.chosen) {
    return rows[*choice.chosen].rate_Hz;
  }
  double lowest_Hz = std::numeric_limits<double>::infinity();
  for (const TuningRow& row : rows) {
    lowest_Hz = std::min(lowest_Hz, row.rate_Hz);
  }
  return lowest_Hz;
}

// Whether a panel shows a row: all budgets at one rate, or the largest budget of each rate and
// every measured row.
bool belongs(const Panel& panel, const TuningRow& row, const std::vector<TuningRow>& rows,
             double budgets_at_Hz) {
  if (panel.over_budgets) {
    return has_grid(row.method) && row.rate_Hz == budgets_at_Hz;
  }
  return row.measured || std::none_of(rows.begin(), rows.end(), [&](const TuningRow& other) {
           return other.method == row.method && other.rate_Hz == row.rate_Hz &&
                  other.fill_budget > row.fill_budget;
         });
}

// Whether a panel has a place for a point: a logarithmic axis has none for zero.
bool has_place(const Panel& panel, double x, double y) {
  const std::string scales = panel.scales;
  return std::isfinite(x) && std::isfinite(y) && (!scales.starts_with('x') || x > 0.0) &&
         (!scales.ends_with('y') || y > 0.0);
}

// The points of one method, from the left to the right.
Points points(const Panel& panel, const std::vector<TuningRow>& rows, const std::string& method,
              double budgets_at_Hz, bool in_loop) {
  Points all;
  for (const TuningRow& row : rows) {
    if (row.method != method || !row.problem.empty() || (in_loop && !row.measured) ||
        (!in_loop && panel.y_on_path == nullptr) || !belongs(panel, row, rows, budgets_at_Hz)) {
      continue;
    }
    const double x = panel.x(row);
    const double y = in_loop ? panel.y_in_loop(row) : panel.y_on_path(row);
    if (has_place(panel, x, y)) {
      all.emplace_back(x, y);
    }
  }
  std::sort(all.begin(), all.end());
  return all;
}

// gnuplot has no range for values that are all equal, and warns.
std::string range(char axis, const std::vector<double>& values, bool logarithmic) {
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  const double margin = *most > *least ? 0.05 * (*most - *least) : 0.1 * std::abs(*most) + 1e-3;
  char text[80];
  std::snprintf(text, sizeof text, "set %crange [%.9g:%.9g]\n", axis,
                logarithmic ? *least / 1.5 : *least - margin,
                logarithmic ? *most * 1.5 : *most + margin);
  return text;
}

std::string draw(const Panel& panel, bool with_key, const std::vector<TuningRow>& rows,
                 const TuningChoice& choice, const TuningTolerance& tolerance) {
  const double budgets_at_Hz = rate_of_budgets_Hz(rows, choice);
  const bool misses = panel.y_in_loop == missed;
  const double tolerated = misses ? tolerance.missed_percent : tolerance.error_percent;
  std::string blocks, curves;
  const std::string scales = panel.scales;
  const bool log_y = scales.ends_with('y');
  const bool shows_tolerated = !log_y || tolerated > 0.0;
  std::vector<double> all_x, all_y;
  if (shows_tolerated) {
    all_y.push_back(tolerated);
  }
  const auto add = [&](const Points& data, const std::string& style) {
    if (data.empty()) {
      return;
    }
    const std::string name = "$d" + std::to_string(std::count(blocks.begin(), blocks.end(), '$'));
    blocks += name + " << EOD\n";
    for (const auto& [x, y] : data) {
      char line[64];
      std::snprintf(line, sizeof line, "%.9g %.9g\n", x, y);
      blocks += line;
      all_x.push_back(x);
      all_y.push_back(y);
    }
    blocks += "EOD\n";
    curves += (curves.empty() ? "plot " : ", ") + name + " " + style;
  };
  const std::vector<std::string> methods = distinct_methods(rows);
  for (std::size_t i = 0; i < methods.size(); ++i) {
    const bool again = i >= std::size(kColours);
    const std::string colour = std::string(" lc rgb '") + kColours[i % std::size(kColours)] + "' ";
    add(points(panel, rows, methods[i], budgets_at_Hz, false),
        std::string("with ") + panel.style + colour + (again ? "dt 4 pt 4" : "pt 1") +
            " ps 0.8 title " + evaluation::quoted(methods[i]));
    add(points(panel, rows, methods[i], budgets_at_Hz, true),
        "with points" + colour + (again ? "pt 5" : "pt 7") + " ps 1 title ''");
  }
  if (choice.chosen && (!panel.over_budgets || has_grid(rows[*choice.chosen].method))) {
    const TuningRow& row = rows[*choice.chosen];
    const double x = panel.x(row);
    const double y = panel.y_in_loop(row);
    add(has_place(panel, x, y) ? Points{{x, y}} : Points{},
        std::string("with points pt 6 ps 2.6 lw 2.5 lc rgb '") + kChosenColour +
            "' title 'chosen'");
  }
  if (curves.empty()) {
    return "set multiplot next\n";
  }
  if (misses) {
    all_y.push_back(0.0);
  }
  char limit[128] = "";
  if (shows_tolerated) {
    std::snprintf(limit, sizeof limit, ", %.9g with lines dt 2 lc rgb '#000000' title 'tolerated'",
                  tolerated);
  }
  return blocks + "unset logscale\n" + (scales.empty() ? "" : "set logscale " + scales + "\n") +
         range('x', all_x, scales.starts_with('x')) + range('y', all_y, log_y) +
         (with_key ? "set key outside right top maxcols 1 font ',9' spacing 0.9 Left reverse\n"
                   : "unset key\n") +
         "set xlabel '" + panel.x_title + "'\nset ylabel '" + panel.y_title + "'\n" + curves +
         limit + "\n";
}

}  // namespace

std::vector<std::string> draw_tuning(const std::string& folder, const std::vector<TuningRow>& rows,
                                     const TuningChoice& choice, const TuningTolerance& tolerance) {
  std::string script = "set grid\nset lmargin 11\nset rmargin 36\n";
  for (const bool svg : {true, false}) {
    script += svg ? "set terminal svg size 900,1400 background '#ffffff' font 'sans,12'\n"
                  : "set terminal pngcairo size 900,1400 background '#ffffff' font 'sans,11'\n";
    script += "set output " + evaluation::quoted(folder + (svg ? "/tuning.svg" : "/tuning.png")) +
              "\nset multiplot layout 4,1 title 'Small marks: on the recorded path. Filled: in the "
              "loop.'\n";
    for (const Panel& panel : kPanels) {
      script += draw(panel, &panel == &kPanels[0], rows, choice, tolerance);
    }
    script += "unset multiplot\n";
  }
  evaluation::run_gnuplot(script, {folder + "/tuning.svg", folder + "/tuning.png"});
  return {folder + "/tuning.svg", folder + "/tuning.png"};
}

}  // namespace forcegrid::tools
