// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart_plot.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "evaluation/charts/label_placement.h"
#include "evaluation/files/gnuplot.h"

namespace forcegrid::evaluation {
namespace {

constexpr double kLeft_px = 90.0;  // margins of the plot
constexpr double kRight_px = 25.0;
constexpr double kBottom_px = 68.0;
constexpr double kTop_px = 48.0;
constexpr double kLetter_px = 6.2;
constexpr double kLine_px = 14.0;
constexpr double kLegendWidth_px = 190.0;  // bottom left
constexpr double kLegendHeight_px = 66.0;
constexpr char kPaperMethod[] = "forcegrid";

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

// The points in order, and what their labels must not cover: the front and the legend.
std::vector<PlacedLabel> labels_of(const std::vector<ChartPoint>& points,
                                   const std::vector<PicturePoint>& at, const PictureBox& plot,
                                   const std::vector<bool>& shown) {
  LabelSurroundings around;
  around.label_height_px = kLine_px;
  around.inside = plot;
  around.boxes.push_back({around.inside.left_px, around.inside.left_px + kLegendWidth_px,
                          around.inside.bottom_px, around.inside.bottom_px + kLegendHeight_px});
  std::vector<LabelledPoint> labelled;
  const PicturePoint* before = nullptr;  // on the front, which goes from point to point
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (shown[i]) {
      labelled.push_back({at[i], kLetter_px * static_cast<double>(label_of(points[i]).size())});
    } else {
      const double r = around.mark_radius_px;
      around.boxes.push_back({at[i].x_px - r, at[i].x_px + r, at[i].y_px - r, at[i].y_px + r});
    }
    if (points[i].on_front) {
      if (before != nullptr) {
        around.lines.push_back({*before, at[i]});
      }
      before = &at[i];
    }
  }
  std::vector<PlacedLabel> placed = place_labels(labelled, around);
  std::vector<PlacedLabel> labels(points.size());
  for (std::size_t i = 0, next = 0; i < points.size(); ++i) {
    if (shown[i]) {
      labels[i] = placed[next++];
    }
  }
  return labels;
}

}  // namespace

bool write_error_cost_svg(const std::filesystem::path& file, const std::string& title,
                          const std::vector<ChartPoint>& all, const ErrorCostLayout& layout) {
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
  const double width_px = layout.width_px;
  const double height_px = layout.height_px;
  const PictureBox plot{kLeft_px, width_px - kRight_px, kBottom_px, height_px - kTop_px};
  std::vector<PicturePoint> at;
  std::vector<bool> shown;
  for (const ChartPoint& point : points) {
    at.push_back(
        {plot.left_px + (plot.right_px - plot.left_px) * x.fraction(point.cycle_ns),
         plot.bottom_px + (plot.top_px - plot.bottom_px) * y.fraction(point.error_percent)});
    shown.push_back(layout.labelled.empty() || point.on_front ||
                    std::find(layout.labelled.begin(), layout.labelled.end(), point.method) !=
                        layout.labelled.end());
  }
  const std::vector<PlacedLabel> labels = labels_of(points, at, plot, shown);

  std::ostringstream script;
  script << "set terminal svg size " << width_px << ',' << height_px
         << " background '#ffffff' font 'sans,13'\nset output " << quoted(file.string())
         << "\nset lmargin at screen " << plot.left_px / width_px << "\nset rmargin at screen "
         << plot.right_px / width_px << "\nset bmargin at screen " << plot.bottom_px / height_px
         << "\nset tmargin at screen " << plot.top_px / height_px
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
    if (!shown[i]) {
      continue;
    }
    const char* const colour = points[i].method == kPaperMethod ? "#C0392B"
                               : points[i].on_front             ? "#0B5394"
                                                                : "#555555";
    const PictureBox& box = labels[i].box;
    // A label to the left of its point ends there, whatever the width of the viewer's font.
    const bool to_the_left = box.right_px < at[i].x_px;
    script << "set label " << quoted(label_of(points[i])) << " at screen "
           << (to_the_left ? box.right_px : box.left_px) / width_px << ", screen "
           << 0.5 * (box.bottom_px + box.top_px) / height_px << (to_the_left ? " right" : " left")
           << " noenhanced font 'sans,11' textcolor rgb '" << colour << "'\n";
    if (labels[i].has_leader) {
      const PictureLine& leader = labels[i].leader;
      script << "set arrow from screen " << leader.from.x_px / width_px << ", screen "
             << leader.from.y_px / height_px << " to screen " << leader.to.x_px / width_px
             << ", screen " << leader.to.y_px / height_px << " nohead lw 0.5 lc rgb '#bbbbbb'\n";
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
