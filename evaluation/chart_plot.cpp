// SPDX-License-Identifier: Apache-2.0
#include "evaluation/chart_plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>

#include "evaluation/gnuplot.h"

namespace forcegrid::evaluation {
namespace {

constexpr double kWidth_px = 1000.0;
constexpr double kHeight_px = 620.0;
constexpr double kLeft = 0.095;  // edges of the plot as fractions of the picture
constexpr double kRight = 0.975;
constexpr double kBottom = 0.11;
constexpr double kTop = 0.92;
constexpr double kLetter_px = 6.6;
constexpr double kLine_px = 14.0;
constexpr char kPaperMethod[] = "forcegrid";

struct Box {
  double left, right, bottom, top;
  bool meets(const Box& other) const {
    return left < other.right && other.left < right && bottom < other.top && other.bottom < top;
  }
};

struct Place {
  double x_px, y_px;
};

// The range of an axis between whole powers of ten that contains all values.
struct LogAxis {
  double low, high;
  explicit LogAxis(const std::vector<double>& values) {
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    low = std::floor(std::log10(*least) - 0.05);
    high = std::max(low + 1.0, std::ceil(std::log10(*most) + 0.05));
  }
  double fraction(double value) const { return (std::log10(value) - low) / (high - low); }
};

std::string label_of(const ChartPoint& point) {
  std::string text = point.method;
  if (point.method == kPaperMethod) {
    text += " (the paper's)";
  }
  return point.condition == "ideal" ? text : text + " [" + point.condition + "]";
}

// Places each label near its point without covering a point or another label.
std::vector<Place> place_labels(const std::vector<ChartPoint>& points,
                                const std::vector<Place>& at) {
  std::vector<Box> taken;
  for (const Place& point : at) {
    taken.push_back({point.x_px - 5.0, point.x_px + 5.0, point.y_px - 5.0, point.y_px + 5.0});
  }
  const Box inside{kLeft * kWidth_px, kRight * kWidth_px, kBottom * kHeight_px, kTop * kHeight_px};
  std::vector<Place> places;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double width_px = kLetter_px * static_cast<double>(label_of(points[i]).size());
    Place best{at[i].x_px + 8.0, at[i].y_px};
    double fewest = std::numeric_limits<double>::infinity();
    for (int ring = 0; ring < 9 && fewest > 0.0; ++ring) {
      for (int step = -ring; step <= ring && fewest > 0.0; ++step) {
        for (const double side : {8.0 + 3.0 * ring, -width_px - 8.0 - 3.0 * ring}) {
          const Place candidate{at[i].x_px + side, at[i].y_px + kLine_px * step};
          const Box box{candidate.x_px, candidate.x_px + width_px, candidate.y_px - 0.5 * kLine_px,
                        candidate.y_px + 0.5 * kLine_px};
          double cost = static_cast<double>(std::count_if(
              taken.begin(), taken.end(), [&box](const Box& each) { return box.meets(each); }));
          cost += box.left < inside.left || box.right > inside.right ||
                          box.bottom < inside.bottom || box.top > inside.top
                      ? 100.0
                      : 0.0;
          if (cost < fewest) {
            fewest = cost;
            best = candidate;
          }
        }
      }
    }
    taken.push_back(
        {best.x_px, best.x_px + width_px, best.y_px - 0.5 * kLine_px, best.y_px + 0.5 * kLine_px});
    places.push_back(best);
  }
  return places;
}

}  // namespace

bool write_error_cost_svg(const std::filesystem::path& file, const std::string& title,
                          const std::vector<ChartPoint>& all) {
  std::vector<ChartPoint> points;
  std::vector<double> costs_ns;
  std::vector<double> errors_percent;
  for (const ChartPoint& point : all) {
    if (point.cycle_ns > 0.0 && point.error_percent > 0.0 && std::isfinite(point.cycle_ns) &&
        std::isfinite(point.error_percent)) {
      points.push_back(point);
      costs_ns.push_back(point.cycle_ns);
      errors_percent.push_back(point.error_percent);
    }
  }
  if (points.empty()) {
    return false;
  }
  const LogAxis x(costs_ns);
  const LogAxis y(errors_percent);
  std::vector<Place> at;
  for (const ChartPoint& point : points) {
    at.push_back({kWidth_px * (kLeft + (kRight - kLeft) * x.fraction(point.cycle_ns)),
                  kHeight_px * (kBottom + (kTop - kBottom) * y.fraction(point.error_percent))});
  }
  const std::vector<Place> labels = place_labels(points, at);

  std::ostringstream script;
  script << "set terminal svg size " << kWidth_px << ',' << kHeight_px
         << " background '#ffffff' font 'sans,13'\nset output " << quoted(file.string())
         << "\nset lmargin at screen " << kLeft << "\nset rmargin at screen " << kRight
         << "\nset bmargin at screen " << kBottom << "\nset tmargin at screen " << kTop
         << "\nset logscale xy\nset xrange [1e" << x.low << ":1e" << x.high << "]\nset yrange [1e"
         << y.low << ":1e" << y.high
         << "]\nset grid lt 1 lw 0.5 lc rgb '#dddddd'\nset border 3\n"
            "set xtics nomirror\nset ytics nomirror\nset format x '10^{%T}'\nset format y '%g'\n"
            "set xlabel 'mean cost of a servo cycle, samples included / ns'\n"
            "set ylabel 'RMS error after 1 s / % of RMS F_o, geometric mean' noenhanced\n"
            "set title "
         << quoted(title) << " noenhanced\nset key bottom left samplen 2\n";
  const auto data = [&](const char* name, const auto& wanted) {
    script << '$' << name << " << EOD\n";
    for (const ChartPoint& point : points) {
      if (wanted(point)) {
        script << point.cycle_ns << ' ' << point.error_percent << '\n';
      }
    }
    script << "EOD\n";
  };
  data("front", [](const ChartPoint& point) { return point.on_front; });
  data("others",
       [](const ChartPoint& point) { return !point.on_front && point.method != kPaperMethod; });
  data("paper", [](const ChartPoint& point) { return point.method == kPaperMethod; });
  for (std::size_t i = 0; i < points.size(); ++i) {
    const char* const colour = points[i].method == kPaperMethod ? "#C0392B"
                               : points[i].on_front             ? "#0B5394"
                                                                : "#555555";
    const double label_x = labels[i].x_px / kWidth_px;
    const double label_y = labels[i].y_px / kHeight_px;
    script << "set label " << quoted(label_of(points[i])) << " at screen " << label_x << ", screen "
           << label_y << " left noenhanced font 'sans,11' textcolor rgb '" << colour << "'\n";
    if (std::abs(labels[i].y_px - at[i].y_px) > kLine_px) {
      const bool to_the_left = labels[i].x_px < at[i].x_px;
      const double width_px = kLetter_px * static_cast<double>(label_of(points[i]).size());
      script << "set arrow from screen " << at[i].x_px / kWidth_px << ", screen "
             << at[i].y_px / kHeight_px << " to screen "
             << (labels[i].x_px + (to_the_left ? width_px : -2.0)) / kWidth_px << ", screen "
             << label_y << " nohead lw 0.5 lc rgb '#bbbbbb'\n";
    }
  }
  const bool has_paper = std::any_of(points.begin(), points.end(), [](const ChartPoint& point) {
    return point.method == kPaperMethod;
  });
  const bool has_others = std::any_of(points.begin(), points.end(), [](const ChartPoint& point) {
    return !point.on_front && point.method != kPaperMethod;
  });
  script << "plot $front with linespoints pt 7 ps 0.8 lw 1.5 lc rgb '#0B5394' title 'Pareto front'";
  if (has_others) {
    script << ", $others with points pt 7 ps 0.6 lc rgb '#999999' title 'dominated'";
  }
  if (has_paper) {
    script << ", $paper with points pt 3 ps 1.4 lw 2 lc rgb '#C0392B' title 'the paper''s method'";
  }
  script << '\n';

  run_gnuplot(script.str(), file);
  return true;
}

}  // namespace forcegrid::evaluation
