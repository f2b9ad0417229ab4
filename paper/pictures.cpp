// SPDX-License-Identifier: Apache-2.0
#include "paper/pictures.h"

#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "evaluation/files/gnuplot.h"

namespace forcegrid::paper {
namespace {

namespace fs = std::filesystem;
using evaluation::quoted;

// Columns of figure7.csv: time, tool along the normal, F_o, then one per method.
constexpr int kTool = 2;
constexpr int kReferenceColumn = 3;
constexpr int kFirstMethod = 4;
constexpr double kEnlarged_s = 1.0;
const char* const kColours[] = {"#E69F00", "#0072B2", "#CC79A7", "#009E73", "#000000"};

std::string head(const fs::path& file, int width_px, int height_px) {
  return "set terminal svg size " + std::to_string(width_px) + "," + std::to_string(height_px) +
         " background '#ffffff' font 'sans,13'\nset output " + quoted(file.string()) +
         "\nset datafile separator ','\nset grid lt 1 lw 0.5 lc rgb '#dddddd'\nset border 3\n"
         "set xtics nomirror\nset ytics nomirror\nset lmargin 9\nset rmargin 3\n"
         "set key outside top center horizontal samplen 2 noenhanced\n";
}

// @param every draws every n-th point; more points than pixels would only enlarge the file.
std::string curve(const fs::path& data, const std::string& expression, const std::string& colour,
                  double width, const std::string& title, std::size_t every) {
  std::ostringstream words;
  words << quoted(data.string()) << " every " << every << " using 1:" << expression
        << " with lines lw " << width << " lc rgb '" << colour << "' title " << quoted(title);
  return words.str();
}

std::string column(int number) { return "($" + std::to_string(number) + ")"; }

// The reference force as a broad pale line, so that curves on top of it are visible.
std::string force_curves(const fs::path& data, std::size_t every) {
  std::string plot = curve(data, column(kReferenceColumn), "#BBBBBB", 4.0, "reference F_o", every);
  for (std::size_t i = 0; i < figure_methods().size(); ++i) {
    plot += ", " + curve(data, column(kFirstMethod + static_cast<int>(i)), kColours[i], 1.2,
                         label_of(figure_methods()[i]), every);
  }
  return plot;
}

std::size_t every_point_drawn(const Figures& figures) {
  constexpr std::size_t kPointsDrawn = 3000;
  return figures.motion.trace.servo.size() / kPointsDrawn + 1;
}

}  // namespace

std::string label_of(const std::string& method) {
  static const std::map<std::string, std::string> labels{{"hold", "streaming F_s"},
                                                         {"forcegrid", "forcegrid F_g, d in mm"},
                                                         {"forcegrid unit=m", "forcegrid, d in m"},
                                                         {"off-line", "reference F_o"}};
  const auto found = labels.find(method);
  return found == labels.end() ? method : found->second;
}

void draw_figure_7(const fs::path& data, const Figures& figures, const fs::path& file) {
  const double end_s = figures.motion.trace.servo.back().time_s;
  const std::size_t every = every_point_drawn(figures);
  std::ostringstream script;
  script << head(file, 1000, 980) << "set multiplot layout 3,1\nset xrange [0:" << end_s
         << "]\nset ylabel 'T: tool along the normal / mm'\nplot "
         << curve(data, column(kTool), "#000000", 1.0, "T", every)
         << "\nset ylabel 'force on the hand along it / N'\nplot " << force_curves(data, every)
         << "\nset xrange [" << end_s - kEnlarged_s << ':' << end_s
         << "]\nset xlabel 'time since contact / s'\nset ylabel 'the last second / N'\nplot "
         << force_curves(data, 1) << "\nunset multiplot\n";
  evaluation::run_gnuplot(script.str(), file);
}

void draw_figure_8(const fs::path& data, const Figures& figures, const fs::path& file) {
  const double end_s = figures.motion.trace.servo.back().time_s;
  std::ostringstream script;
  script << head(file, 1000, 760) << "$fifths << EOD\n";
  for (const Fifth& fifth : figures.fifths) {
    script << 0.5 * (fifth.begin_s + fifth.end_s);
    for (const double percent : fifth.rms_error_percent) {
      script << ',' << percent;
    }
    script << '\n';
  }
  script << "EOD\nset multiplot layout 2,1\nset xrange [0:" << end_s
         << "]\nset ylabel 'error along the normal / N'\nplot ";
  for (std::size_t i = 0; i < figure_methods().size(); ++i) {
    const std::string error = "($" + std::to_string(kFirstMethod + static_cast<int>(i)) + "-$" +
                              std::to_string(kReferenceColumn) + ")";
    script << (i == 0 ? "" : ", ")
           << curve(data, error, kColours[i], 1.0, label_of(figure_methods()[i]),
                    every_point_drawn(figures));
  }
  script
      << "\nset xlabel 'time since contact / s'\nset ylabel 'RMS error by fifths / % of RMS F_o' "
         "noenhanced\nset logscale y\nset yrange [*:100]\nset format y '%g'\nplot ";
  for (std::size_t i = 0; i < figure_methods().size(); ++i) {
    script << (i == 0 ? "" : ", ") << "$fifths using 1:" << i + 2
           << " with linespoints pt 7 ps 0.7 lw 1.5 lc rgb '" << kColours[i] << "' title "
           << quoted(label_of(figure_methods()[i]));
  }
  script << "\nunset multiplot\n";
  evaluation::run_gnuplot(script.str(), file);
}

void draw_resolutions(const std::vector<ResolutionRow>& rows, const fs::path& file) {
  std::vector<std::string> motions;
  std::set<int> resolutions;
  for (const ResolutionRow& row : rows) {
    if (std::find(motions.begin(), motions.end(), row.motion) == motions.end()) {
      motions.push_back(row.motion);
    }
    resolutions.insert(row.vertices);
  }
  std::ostringstream script;
  script << head(file, 1000, 420 * static_cast<int>(motions.size()));
  for (std::size_t m = 0; m < motions.size(); ++m) {
    for (const int vertices : resolutions) {
      script << "$m" << m << '_' << vertices << " << EOD\n";
      for (const ResolutionRow& row : rows) {
        if (row.motion == motions[m] && row.vertices == vertices) {
          script << 1e3 * row.radius_m << ',' << row.rms_error_percent << '\n';
        }
      }
      script << "EOD\n";
    }
  }
  script << "set multiplot layout " << motions.size() << ",1\nset logscale xy\n"
         << "set format '%g'\nset xtics (3.3, 5, 7, 10, 13, 20, 27, 40, 53)\n"
            "set xrange [3:60]\nset xlabel 'r / mm'\n";
  for (std::size_t m = 0; m < motions.size(); ++m) {
    const auto any = std::find_if(rows.begin(), rows.end(), [&](const ResolutionRow& row) {
      return row.motion == motions[m];
    });
    const double travel_mm = 1e3 * any->radius_m / any->radius_over_travel;
    script << "unset object\nunset arrow\nunset label\nset object 1 rect from " << 2.0 * travel_mm
           << ", graph 0 to " << 3.0 * travel_mm
           << ", graph 1 fc rgb '#F3E3C3' fs solid 0.6 noborder behind\nset label 1 at "
           << 2.05 * travel_mm << ", graph 0.05 'rule: 2 to 3 travels' font 'sans,11'\n"
           << "set arrow 1 from 26.667, graph 0 to 26.667, graph 1 nohead dt 2 lc rgb '#888888'\n"
           << "set label 2 at 27.2, graph 0.95 'used: 1/6 of W' font 'sans,11'\n"
           << "set ylabel '" << motions[m]
           << ": RMS error after 1 s / % of RMS F_o' noenhanced\nplot ";
    std::size_t colour = 0;
    for (const int vertices : resolutions) {
      script << (colour == 0 ? "" : ", ") << "$m" << m << '_' << vertices
             << " using 1:2 with linespoints pt 7 ps 0.7 lw 1.5 lc rgb '" << kColours[colour]
             << "' title '" << vertices << " x " << vertices << " x " << vertices << " vertices'";
      ++colour;
    }
    script << '\n';
  }
  script << "unset multiplot\n";
  evaluation::run_gnuplot(script.str(), file);
}

void draw_discrimination(const Discrimination& all, const fs::path& file) {
  const double weber = all.rows.front().weber_fraction;
  // Identical objects have zero contrast, which a logarithmic axis can't show.
  constexpr double kPlaceOfNone = 0.015;
  std::ostringstream script;
  script << head(file, 1000, 840);
  const Knowledge ways[] = {Knowledge::kSameRendering, Knowledge::kRealForces};
  for (std::size_t way = 0; way < 2; ++way) {
    for (std::size_t i = 0; i < discrimination_methods().size(); ++i) {
      script << "$w" << way << '_' << i << " << EOD\n";
      for (const DiscriminationRow& row : all.rows) {
        if (row.knowledge == ways[way] && row.weber_fraction == weber &&
            row.method == discrimination_methods()[i]) {
          // Side by side, so that the intervals do not overlap.
          const double at = row.contrast > 0.0 ? row.contrast : kPlaceOfNone;
          script << at * (1.0 + 0.03 * (static_cast<double>(i) - 2.0)) << ','
                 << row.answers.percent() << ',' << row.answers.low_percent() << ','
                 << row.answers.high_percent() << '\n';
        }
      }
      script << "EOD\n";
    }
  }
  script << "set multiplot layout 2,1\nset logscale x\nset xrange [0.013:1.15]\nset yrange "
            "[0:105]\nset xtics ('same thing' 0.015, 0.03, 0.06, 0.12, 0.25, 0.5, 1)\n"
            "set arrow 1 from graph 0, first 33.33 to graph 1, first 33.33 nohead dt 2 lc rgb "
            "'#888888'\nset label 1 at 0.9, 36 'chance' right font 'sans,11'\n"
            "set xlabel 'difference of the objects (1: unchanged)'\n";
  const char* const titles[] = {"learned through the same method", "known by their real forces"};
  for (std::size_t way = 0; way < 2; ++way) {
    script << "set ylabel 'right / %, " << titles[way] << "'\nplot ";
    for (std::size_t i = 0; i < discrimination_methods().size(); ++i) {
      const std::string& method = discrimination_methods()[i];
      const auto known = std::find(figure_methods().begin(), figure_methods().end(), method);
      const char* const colour =
          kColours[std::distance(figure_methods().begin(), known)];  // black: the reference force
      script << (i == 0 ? "" : ", ") << "$w" << way << '_' << i
             << " using 1:2:3:4 with yerrorlines pt 7 ps 0.6 lw 1.3 lc rgb '" << colour
             << "' title " << quoted(label_of(method));
    }
    script << '\n';
  }
  script << "unset multiplot\n";
  evaluation::run_gnuplot(script.str(), file);
}

}  // namespace forcegrid::paper
