// SPDX-License-Identifier: Apache-2.0
#include "stability/chart_pictures.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>

#include "evaluation/files/gnuplot.h"
#include "stability/theory.h"

namespace forcegrid::stability {
namespace {

namespace fs = std::filesystem;

struct Point {
  double x, y;
};

struct Curve {
  std::string title;
  std::string style;  ///< of gnuplot
  std::vector<Point> points;
};

struct Picture {
  std::string title;
  std::string x_label;
  std::string y_label;
  std::string axes;  ///< further settings of gnuplot
  std::vector<Curve> curves;
  int width_px = 860;
  int plot_height_px = 480;  ///< with title and the axis's label, without the legend
};

constexpr const char* kColours[] = {"#0B5394", "#C0392B", "#1A7F37", "#8E44AD", "#D68910",
                                    "#148F77", "#7B241C", "#5D6D7E", "#AF7AC5", "#2E86C1"};
constexpr const char* kStrongColour = "#000000";
// gnuplot drops, without a word, the entries of a legend that has no room for them. The picture is
// therefore as high as its legend demands.
constexpr int kEntryHeight_px = 20;
constexpr int kLetter_px = 9;   // at most, with the font below
constexpr int kSample_px = 70;  // a legend's entry without its letters

// Colours and marks begin again after ten curves, with dashes.
std::string measured_style(std::size_t number, bool strong = false) {
  const std::size_t colour = number % std::size(kColours);
  std::ostringstream style;
  style << "with linespoints lw " << (strong ? 2.5 : 1.5) << " ps " << (strong ? 1.0 : 0.8)
        << " pt " << (strong ? 7 : 4 + colour) << " dt "
        << (strong || number < std::size(kColours) ? 1 : 5) << " lc rgb '"
        << (strong ? kStrongColour : kColours[colour]) << '\'';
  return style.str();
}

// The method that the chart is about gets a thick black line. The exact force, which good methods
// reach, gets a wide light one that lies below them.
std::string style_of(const std::string& method, std::size_t number,
                     const std::string& default_method) {
  return method == kExact ? "with lines lw 7 lc rgb '#B8C4D0'"
                          : measured_style(number, method == default_method);
}

std::string theory_style(int number) {
  std::ostringstream style;
  style << "with lines lw 2 dt " << 2 + number << " lc rgb '#555555'";
  return style.str();
}

bool has_points(const Curve& curve) {
  return std::any_of(curve.points.begin(), curve.points.end(), [](const Point& point) {
    return std::isfinite(point.x) && std::isfinite(point.y);
  });
}

// The size of the picture and its legend, below the plot.
std::string layout_of(const Picture& picture) {
  std::size_t entries = 0;
  std::size_t longest = 0;
  for (const Curve& curve : picture.curves) {
    if (has_points(curve)) {
      ++entries;
      longest = std::max(longest, curve.title.size());
    }
  }
  const int entry_px = kSample_px + kLetter_px * static_cast<int>(longest);
  const std::size_t columns = 2 * entry_px <= picture.width_px ? 2 : 1;
  const std::size_t rows = (entries + columns - 1) / columns;
  const int legend_px = kEntryHeight_px * static_cast<int>(rows) + 10;
  const int height_px = picture.plot_height_px + legend_px;
  std::ostringstream script;
  script << "set terminal svg size " << picture.width_px << ',' << height_px
         << " background '#ffffff' font 'sans,13'\nset bmargin at screen "
         << static_cast<double>(legend_px + 60) / height_px << "\nset key at screen 0.5, screen "
         << static_cast<double>(legend_px) / height_px
         << " center top vertical Left reverse maxrows " << rows << " noenhanced\n";
  return script.str();
}

// Returns false if no curve has a point.
bool draw(const Picture& picture, const fs::path& file) {
  std::ostringstream script;
  script << layout_of(picture) << "set output " << evaluation::quoted(file.string())
         << "\nset title " << evaluation::quoted(picture.title) << " noenhanced\nset xlabel "
         << evaluation::quoted(picture.x_label) << " noenhanced\nset ylabel "
         << evaluation::quoted(picture.y_label)
         << " noenhanced\nset grid lt 1 lw 0.5 lc rgb '#dddddd'\nset border 3\n"
            "set xtics nomirror\nset ytics nomirror\n"
         << picture.axes;
  std::string plots;
  for (std::size_t i = 0; i < picture.curves.size(); ++i) {
    const Curve& curve = picture.curves[i];
    if (!has_points(curve)) {
      continue;
    }
    std::ostringstream data;
    for (const Point& point : curve.points) {
      if (std::isfinite(point.x) && std::isfinite(point.y)) {
        data << point.x << ' ' << point.y << '\n';
      }
    }
    script << "$c" << i << " << EOD\n" << data.str() << "EOD\n";
    plots += (plots.empty() ? "plot $c" : ", $c") + std::to_string(i) + ' ' + curve.style +
             " title " + evaluation::quoted(curve.title);
  }
  if (plots.empty()) {
    return false;
  }
  script << plots << '\n';
  evaluation::run_gnuplot(script.str(), file);
  return true;
}

std::string words_of(const Hand& hand) { return (hand.holds() ? hand.name : "no") + " hand"; }

// Zero is drawn at the bottom of a logarithmic axis.
double shown_N_per_m(const StabilityRow& row) {
  return std::max(row.limit.largest_stable_N_per_m, 0.8 * StiffnessScan::kLeast_N_per_m);
}

const char kStiffnessAxis[] = "set logscale y\nset yrange [2:20000]\n";

Picture over_delay(const StabilityChart& chart, const Hand& hand, double servo_rate_Hz,
                   const std::string& default_method) {
  Picture picture;
  picture.title = "Largest stable stiffness, " + words_of(hand) + ", " +
                  std::to_string(std::lround(servo_rate_Hz)) +
                  " Hz on a full-speed bus, simulator at 30 Hz";
  picture.x_label = "network delay in addition to the simulator's period / ms";
  picture.y_label = "K / (N/m)";
  picture.axes = std::string(kStiffnessAxis) + "set xrange [0:150]\n";
  std::vector<std::string> order;
  std::map<std::string, std::vector<Point>> points;
  for (const StabilityRow& row : chart.rows) {
    const StabilityCase& cell = row.cell;
    if (cell.part != part::kMap || cell.hand != hand.name || cell.timing != "w2_full_speed" ||
        cell.servo_rate_Hz != servo_rate_Hz || cell.loss > 0.0 ||
        (cell.method != kExact && cell.simulator_rate_Hz != 30.0)) {
      continue;
    }
    if (points.find(cell.method) == points.end()) {
      order.push_back(cell.method);
    }
    points[cell.method].push_back({1e3 * cell.delay_s, shown_N_per_m(row)});
    if (cell.method == kExact) {
      points[cell.method].push_back({150.0, shown_N_per_m(row)});
    }
  }
  for (std::size_t i = 0; i < order.size(); ++i) {
    picture.curves.push_back({order[i], style_of(order[i], i, default_method), points[order[i]]});
  }
  if (order.empty()) {
    return picture;
  }
  const SampledSpring spring = sampled_spring({}, hand, 1.0 / servo_rate_Hz, 0.0);
  const double passive = colgate_schenkel_N_per_m(spring.damping_N_s_per_m, spring.period_s, 0.0);
  picture.curves.push_back(
      {"b > K T / 2 (Colgate, Schenkel)", theory_style(0), {{0.0, passive}, {150.0, passive}}});
  Curve rule{"K < b / age (hold)", theory_style(1), {}};
  for (double delay_ms = 0.0; delay_ms <= 150.0; delay_ms += 5.0) {
    // On average, a held sample is one and a half periods old.
    rule.points.push_back(
        {delay_ms, delay_rule_N_per_m(spring.damping_N_s_per_m, 1.5 / 30.0 + 1e-3 * delay_ms)});
  }
  picture.curves.push_back(rule);
  return picture;
}

Picture over_rate(const StabilityChart& chart, const Hand& hand,
                  const std::string& default_method) {
  Picture picture;
  picture.title = "Largest stable stiffness, " + words_of(hand) + ", ideal device, 30 Hz";
  picture.x_label = "servo rate / Hz";
  picture.y_label = "K / (N/m)";
  picture.axes = std::string(kStiffnessAxis) +
                 "set logscale x 2\nset xrange [450:4400]\nset xtics (500,1000,2000,4000)\n";
  std::vector<std::string> methods = {kExact, default_method, "hold"};
  methods.erase(std::unique(methods.begin(), methods.end()), methods.end());
  for (std::size_t i = 0; i < methods.size(); ++i) {
    Curve curve{methods[i], style_of(methods[i], i, default_method), {}};
    for (const StabilityRow& row : chart.rows) {
      const StabilityCase& cell = row.cell;
      if (cell.part == part::kMap && cell.hand == hand.name && cell.timing == "ideal" &&
          cell.method == methods[i] && cell.delay_s == 0.0 && cell.loss == 0.0 &&
          (cell.method == kExact || cell.simulator_rate_Hz == 30.0)) {
        curve.points.push_back({cell.servo_rate_Hz, shown_N_per_m(row)});
      }
    }
    picture.curves.push_back(curve);
  }
  if (picture.curves.front().points.empty()) {
    picture.curves.clear();
    return picture;
  }
  Curve passive{"b > K T / 2 (Colgate, Schenkel)", theory_style(0), {}};
  for (const double rate_Hz : {500.0, 4000.0}) {
    passive.points.push_back(
        {rate_Hz, colgate_schenkel_N_per_m(sampled_spring({}, hand, 1.0, 0.0).damping_N_s_per_m,
                                           1.0 / rate_Hz, 0.0)});
  }
  picture.curves.push_back(passive);
  return picture;
}

Picture plane(const StabilityChart& chart, const Hand& hand) {
  Picture picture;
  picture.title =
      "Stiffness over virtual damping, a spring, " + words_of(hand) + ", ideal device at 500 Hz";
  picture.x_label = "B / (Ns/m)";
  picture.y_label = "largest stable K / (N/m)";
  picture.axes = "set xrange [0:12]\nset yrange [0:*]\n";
  std::size_t number = 0;
  double most_damping = 0.0;
  std::vector<std::pair<std::string, std::string>> kinds;
  for (const StabilityRow& row : chart.rows) {
    const std::pair kind{row.cell.method, row.cell.device};
    if (row.cell.part == part::kPlane && row.cell.hand == hand.name &&
        std::find(kinds.begin(), kinds.end(), kind) == kinds.end()) {
      kinds.push_back(kind);
    }
  }
  for (const auto& [method, kind] : kinds) {
    Curve curve{method + ", " + kind + " device", measured_style(number++), {}};
    for (const StabilityRow& row : chart.rows) {
      if (row.cell.part == part::kPlane && row.cell.hand == hand.name &&
          row.cell.method == method && row.cell.device == kind) {
        curve.points.push_back(
            {row.cell.virtual_damping_N_s_per_m, row.limit.largest_stable_N_per_m});
        most_damping = std::max(most_damping, row.cell.virtual_damping_N_s_per_m);
      }
    }
    picture.curves.push_back(curve);
  }
  if (kinds.empty()) {
    return picture;
  }
  SampledSpring spring = sampled_spring({}, hand, 1.0 / 500.0, 0.0);
  Curve eigenvalues{"eigenvalues of the linear plant", theory_style(0), {}};
  Curve passive{"b > K T / 2 + |B| (Colgate, Schenkel)", theory_style(1), {}};
  for (double damping = 0.0; damping <= most_damping; damping += 0.05 * most_damping) {
    spring.virtual_damping_N_s_per_m = damping;
    eigenvalues.points.push_back({damping, eigenvalue_limit_N_per_m(spring)});
    passive.points.push_back(
        {damping, colgate_schenkel_N_per_m(spring.damping_N_s_per_m, spring.period_s, damping)});
  }
  picture.curves.push_back(eigenvalues);
  picture.curves.push_back(passive);
  const double by_friction = abbott_okamura_N_per_m(spring.damping_N_s_per_m, spring.period_s, 0.1,
                                                    DeviceDynamics{}.position_step_m);
  picture.curves.push_back({"min(2 b / T, 2 f_c / step), f_c = 0.1 N (Abbott, Okamura)",
                            theory_style(2),
                            {{0.0, by_friction}, {most_damping, by_friction}}});
  return picture;
}

Picture against_eigenvalues(const StabilityChart& chart) {
  Picture picture;
  picture.title =
      "Linear plant without friction or quantisation: boundary in simulation against eigenvalues";
  picture.x_label = "eigenvalue limit / (N/m)";
  picture.y_label = "largest stable K in simulation / (N/m)";
  picture.axes = "set logscale xy\nset xrange [2:20000]\nset yrange [2:20000]\n";
  std::size_t number = 0;
  for (const char* const method : {kExact, "hold"}) {
    Curve curve{method, measured_style(number++), {}};
    curve.style.replace(curve.style.find("linespoints"), 11, "points");
    for (const StabilityRow& row : chart.rows) {
      if (row.cell.part == part::kLinear && row.cell.method == method && !row.limit.beyond_scan) {
        curve.points.push_back({eigenvalue_limit_of(row.cell), shown_N_per_m(row)});
      }
    }
    picture.curves.push_back(curve);
  }
  if (picture.curves.front().points.empty()) {
    picture.curves.clear();
    return picture;
  }
  for (const double factor : {1.0, 0.9, 1.1}) {
    picture.curves.push_back({factor == 1.0  ? "equal"
                              : factor < 1.0 ? "-10 %"
                                             : "+10 %",
                              theory_style(factor == 1.0 ? 0 : 1),
                              {{2.0, 2.0 * factor}, {20000.0, 20000.0 * factor}}});
  }
  return picture;
}

}  // namespace

bool draw_stiffness(const StabilityChart& chart, const std::string& default_method,
                    const fs::path& file) {
  Picture picture = over_delay(chart, hand_of("light"), 500.0, default_method);
  picture.title = "Light hand, 500 Hz on a full-speed bus, simulator at 30 Hz";
  picture.width_px = 640;
  picture.plot_height_px = 390;
  return !picture.curves.empty() && draw(picture, file);
}

std::vector<fs::path> draw_pictures(const StabilityChart& chart, const std::string& default_method,
                                    const fs::path& folder) {
  std::vector<fs::path> files;
  const auto add = [&](const std::string& name, const Picture& picture) {
    const fs::path file = folder / (name + ".svg");
    if (!picture.curves.empty() && draw(picture, file)) {
      files.push_back(file);
    }
  };
  for (const Hand& hand : hands()) {
    add("delay_" + hand.name + "_500Hz", over_delay(chart, hand, 500.0, default_method));
    add("delay_" + hand.name + "_1000Hz", over_delay(chart, hand, 1000.0, default_method));
  }
  for (const Hand& hand : hands()) {
    add("rate_" + hand.name, over_rate(chart, hand, default_method));
  }
  for (const Hand& hand : hands()) {
    add("plane_" + hand.name, plane(chart, hand));
  }
  add("eigenvalues", against_eigenvalues(chart));
  return files;
}

}  // namespace forcegrid::stability
