// SPDX-License-Identifier: Apache-2.0
#include "tools/recording_plot.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iomanip>
#include <stdexcept>

#include "evaluation/gnuplot.h"

namespace forcegrid::tools {
namespace {

constexpr std::uint64_t kPointsDrawn = 2000;
constexpr std::uint64_t kRowsAtOnce = 50'000;

double norm3(const std::vector<double>& numbers, std::size_t at) {
  return std::sqrt(numbers[at] * numbers[at] + numbers[at + 1] * numbers[at + 1] +
                   numbers[at + 2] * numbers[at + 2]);
}

// One point of the picture, for a span of cycles.
struct Point {
  double time_s = 0.0;
  double position_mm[3] = {};
  double asked_N = 0.0;
  double sent_N = 0.0;
  double period_us = 0.0;
  double wakeup_us = 0.0;
  double compute_us = 0.0;
  double report_age_ms = 0.0;
  double sample_age_ms = 0.0;
  double work_J = 0.0;
};

// Columns of a block of rows.
struct Block {
  Block(const Hdf5Reader& reader, std::uint64_t rows, std::uint64_t first)
      : time_s(reader.numbers("/cycles/time_s", rows, first)),
        cycle(reader.numbers("/cycles/cycle", rows, first)),
        position_m(reader.numbers("/cycles/position_W_m", rows, first)),
        asked_N(reader.numbers("/cycles/asked_force_W_N", rows, first)),
        sent_N(reader.numbers("/cycles/sent_force_D_N", rows, first)),
        period_us(reader.numbers("/cycles/period_us", rows, first)),
        wakeup_us(reader.numbers("/cycles/wakeup_us", rows, first)),
        compute_us(reader.numbers("/cycles/compute_us", rows, first)),
        report_age_us(reader.numbers("/cycles/report_age_us", rows, first)),
        sample_age_ms(reader.numbers("/cycles/sample_age_ms", rows, first)),
        missed(reader.numbers("/cycles/missed_deadlines", rows, first)),
        work_J(reader.numbers("/cycles/work_on_hand_J", rows, first)) {}

  std::vector<double> time_s, cycle, position_m, asked_N, sent_N, period_us, wakeup_us, compute_us,
      report_age_us, sample_age_ms, missed, work_J;
};

void write_csv(const std::string& file, const std::vector<Point>& points) {
  errno = 0;
  std::ofstream stream(file);
  stream << "time_s,x_mm,y_mm,z_mm,asked_force_N,sent_force_N,period_max_us,wakeup_max_us,"
            "compute_max_us,report_age_max_ms,sample_age_max_ms,work_on_hand_J\n"
         << std::setprecision(9);
  for (const Point& p : points) {
    stream << p.time_s << ',' << p.position_mm[0] << ',' << p.position_mm[1] << ','
           << p.position_mm[2] << ',' << p.asked_N << ',' << p.sent_N << ',' << p.period_us << ','
           << p.wakeup_us << ',' << p.compute_us << ',' << p.report_age_ms << ',' << p.sample_age_ms
           << ',' << p.work_J << '\n';
  }
  stream.close();
  if (!stream) {
    throw std::runtime_error(file + " can't be written (" + std::strerror(errno) +
                             "); free some space or choose another folder with --out");
  }
}

std::string curve(const std::string& data, int column, const std::string& title, int style) {
  return data + " using 1:" + std::to_string(column) + " with lines ls " + std::to_string(style) +
         " title '" + title + "'";
}

std::string panels(const std::string& data) {
  const auto panel = [](const std::string& label, const std::string& plots) {
    return "set ylabel '" + label + "'\nplot " + plots + "\n";
  };
  return panel("tool / mm", curve(data, 2, "x", 1) + ", " + curve(data, 3, "y", 2) + ", " +
                                curve(data, 4, "z", 3)) +
         panel("force / N", curve(data, 5, "asked for", 2) + ", " + curve(data, 6, "sent", 1)) +
         "set logscale y\n" +
         panel("time / us", curve(data, 7, "period, worst", 1) + ", " +
                                curve(data, 8, "wake-up, worst", 2) + ", " +
                                curve(data, 9, "compute, worst", 3)) +
         panel("age / ms",
               curve(data, 10, "report, worst", 1) + ", " + curve(data, 11, "sample, worst", 2)) +
         "unset logscale y\nset xlabel 'time / s'\n" +
         panel("work on the hand / J", curve(data, 12, "negative: the hand worked", 1)) +
         "unset xlabel\n";
}

void draw(const std::string& folder, const std::string& csv) {
  const std::string data = evaluation::quoted(csv);
  std::string script =
      "set datafile separator ','\n"
      "set style line 1 lc rgb '#000000' lw 1.2\nset style line 2 lc rgb '#E69F00' lw 1.2\n"
      "set style line 3 lc rgb '#0072B2' lw 1.2\n"
      "set grid lt 1 lw 0.5 lc rgb '#dddddd'\nset key outside top center horizontal samplen 2\n"
      "set lmargin 10\nset rmargin 3\nset ytics nomirror\nset xtics nomirror\nset border 3\n";
  for (const bool svg : {true, false}) {
    script += svg ? "set terminal svg size 1000,1300 background '#ffffff' font 'sans,13'\n"
                  : "set terminal pngcairo size 1000,1300 background '#ffffff' font 'sans,11'\n";
    script += "set output " +
              evaluation::quoted(folder + (svg ? "/recording.svg" : "/recording.png")) +
              "\nset multiplot layout 5,1\n" + panels(data) + "unset multiplot\n";
  }
  evaluation::run_gnuplot(script, {folder + "/recording.svg", folder + "/recording.png"});
}

}  // namespace

RecordingPlot plot_recording(const Hdf5Reader& reader, const std::string& folder) {
  RecordingPlot plot;
  plot.header = read_header(reader);
  const std::uint64_t rows = plot.header.cycles;
  if (rows < 2) {
    throw std::runtime_error("the recording has fewer than two cycles; there is nothing to draw");
  }
  const std::uint64_t span = rows / kPointsDrawn + 1;
  std::vector<Point> points;
  double first_s = 0.0;
  double last_cycle = 0.0;
  for (std::uint64_t first = 0; first < rows; first += kRowsAtOnce) {
    const Block block(reader, std::min(kRowsAtOnce, rows - first), first);
    const std::size_t asked = 3 * plot.header.method_names.size();
    for (std::size_t i = 0; i < block.time_s.size(); ++i) {
      const std::uint64_t row = first + i;
      first_s = row == 0 ? block.time_s[i] : first_s;
      plot.cycles_lost +=
          row == 0 ? 0 : static_cast<std::uint64_t>(block.cycle[i] - last_cycle - 1.0);
      last_cycle = block.cycle[i];
      plot.duration_s = block.time_s[i] - first_s;
      plot.missed_deadlines += static_cast<std::uint64_t>(block.missed[i]);
      plot.period_max_us = std::max(plot.period_max_us, block.period_us[i]);
      plot.force_max_N = std::max(plot.force_max_N, norm3(block.sent_N, 3 * i));
      if (row % span == 0) {
        Point point;
        point.time_s = block.time_s[i];
        for (std::size_t axis = 0; axis < 3; ++axis) {
          point.position_mm[axis] = 1e3 * block.position_m[3 * i + axis];
        }
        point.asked_N = norm3(block.asked_N, asked * i);
        point.sent_N = norm3(block.sent_N, 3 * i);
        point.work_J = block.work_J[i];
        points.push_back(point);
      }
      Point& point = points.back();
      point.period_us = std::max(point.period_us, block.period_us[i]);
      point.wakeup_us = std::max(point.wakeup_us, block.wakeup_us[i]);
      point.compute_us = std::max(point.compute_us, block.compute_us[i]);
      point.report_age_ms = std::max(point.report_age_ms, 1e-3 * block.report_age_us[i]);
      point.sample_age_ms = std::max(point.sample_age_ms, block.sample_age_ms[i]);
    }
  }
  const std::string csv = folder + "/recording.csv";
  write_csv(csv, points);
  draw(folder, csv);
  plot.files = {csv, folder + "/recording.svg", folder + "/recording.png"};
  return plot;
}

}  // namespace forcegrid::tools
