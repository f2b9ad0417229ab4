// SPDX-License-Identifier: Apache-2.0
#include "tools/recording_plot.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iomanip>
#include <ostream>
#include <stdexcept>

#include "evaluation/files/gnuplot.h"
#include "text/output_file.h"

namespace forcegrid::tools {
namespace {

constexpr std::uint64_t kPointsDrawn = 2000;
constexpr std::uint64_t kRowsAtOnce = 50'000;
constexpr double kAroundContact_s = 0.1;  // drawn before and after the contact

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
  text::OutputFile output(file);
  std::ostream& stream = output.stream();
  stream << "time_s,x_mm,y_mm,z_mm,asked_force_N,sent_force_N,period_max_us,wakeup_max_us,"
            "compute_max_us,report_age_max_ms,sample_age_max_ms,work_on_hand_J\n"
         << std::setprecision(9);
  for (const Point& p : points) {
    stream << p.time_s << ',' << p.position_mm[0] << ',' << p.position_mm[1] << ','
           << p.position_mm[2] << ',' << p.asked_N << ',' << p.sent_N << ',' << p.period_us << ','
           << p.wakeup_us << ',' << p.compute_us << ',' << p.report_age_ms << ',' << p.sample_age_ms
           << ',' << p.work_J << '\n';
  }
  output.finish();
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
         panel("force / N", curve(data, 5, "asked for", 4) + ", " + curve(data, 6, "sent", 1)) +
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

std::string terminal_of(const std::string& format, int width_px) {
  constexpr double kHeightOverWidth = 1.3;
  constexpr double kPixelsAnInch = 96.0;
  char text[160];
  if (format == "pdf") {
    std::snprintf(text, sizeof text,
                  "set terminal pdfcairo size %.3fin,%.3fin background '#ffffff' font 'sans,10'\n",
                  width_px / kPixelsAnInch, kHeightOverWidth * width_px / kPixelsAnInch);
  } else {
    std::snprintf(text, sizeof text,
                  "set terminal %s size %d,%.0f background '#ffffff' font '%s'\n",
                  format == "svg" ? "svg" : "pngcairo", width_px, kHeightOverWidth * width_px,
                  format == "svg" ? "sans,13" : "sans,11");
  }
  return text;
}

std::vector<std::string> draw(const std::string& folder, const std::string& csv,
                              const RecordingPlotOptions& options, double from_s, double to_s) {
  const std::string data = evaluation::quoted(csv);
  std::string script =
      "set datafile separator ','\n"
      "set style line 1 lc rgb '#000000' lw 1.2\nset style line 2 lc rgb '#E69F00' lw 1.2\n"
      "set style line 3 lc rgb '#0072B2' lw 1.2\nset style line 4 lc rgb '#F2CE7A' lw 5\n"
      "set grid lt 1 lw 0.5 lc rgb '#dddddd'\nset key outside top center horizontal samplen 2\n"
      "set lmargin 10\nset rmargin 3\nset ytics nomirror\nset xtics nomirror\nset border 3\n";
  char range[96];
  std::snprintf(range, sizeof range, "set xrange [%.9g:%.9g]\n", from_s, to_s);
  script += range;
  std::vector<std::filesystem::path> pictures;
  std::vector<std::string> files;
  for (const std::string& format : options.formats) {
    files.push_back(folder + "/recording." + format);
    pictures.emplace_back(files.back());
    script += terminal_of(format, options.width_px) + "set output " +
              evaluation::quoted(files.back()) + "\nset multiplot layout 5,1\n" + panels(data) +
              "unset multiplot\n";
  }
  evaluation::run_gnuplot(script + "unset output\n", pictures);
  return files;
}

// The rows [begin, end) of a recording.
struct Rows {
  std::uint64_t begin = 0;
  std::uint64_t end = 0;
};

std::string in_seconds(double time_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g s", time_s);
  return text;
}

class Plotting {
 public:
  Plotting(const Hdf5Reader& reader, const RecordingPlotOptions& options)
      : reader_(reader), options_(options) {
    plot_.header = read_header(reader);
    if (plot_.header.cycles < 2) {
      throw std::runtime_error("the recording has fewer than two cycles; there is nothing to draw");
    }
  }

  RecordingPlot draw_into(const std::string& folder) {
    find_times();
    const Rows window = chosen_rows();
    read_rows(window);
    const std::string csv = folder + "/recording.csv";
    write_csv(csv, points_);
    plot_.files = draw(folder, csv, options_, plot_.drawn_from_s, plot_.drawn_to_s);
    plot_.files.insert(plot_.files.begin(), csv);
    return std::move(plot_);
  }

 private:
  // Calls take(row, time, in contact) for every row.
  template <typename Take>
  void each_time(const Take& take) const {
    for (std::uint64_t first = 0; first < plot_.header.cycles; first += kRowsAtOnce) {
      const std::uint64_t count = std::min(kRowsAtOnce, plot_.header.cycles - first);
      const std::vector<double> time_s = reader_.numbers("/cycles/time_s", count, first);
      const std::vector<double> contact = reader_.numbers("/cycles/in_contact", count, first);
      for (std::size_t i = 0; i < time_s.size(); ++i) {
        take(first + i, time_s[i], contact[i] != 0.0);
      }
    }
  }

  void find_times() {
    each_time([this](std::uint64_t row, double time_s, bool in_contact) {
      begins_s_ = row == 0 ? time_s : begins_s_;
      ends_s_ = time_s;
      if (in_contact) {
        plot_.contact_from_s = plot_.contact_from_s.value_or(time_s);
        plot_.contact_to_s = time_s;
      }
    });
    plot_.duration_s = ends_s_ - begins_s_;
  }

  Rows chosen_rows() {
    double from_s = options_.from_s.value_or(begins_s_);
    double to_s = options_.to_s.value_or(ends_s_);
    if (options_.contact_only) {
      if (!plot_.contact_from_s) {
        throw std::runtime_error(
            "the recording has no contact to zoom in on; draw all of it, or a part with --from and "
            "--to");
      }
      from_s = *plot_.contact_from_s - kAroundContact_s;
      to_s = *plot_.contact_to_s + kAroundContact_s;
    }
    Rows rows{plot_.header.cycles, 0};
    each_time([&](std::uint64_t row, double time_s, bool /*in_contact*/) {
      if (time_s >= from_s && time_s <= to_s) {
        rows.begin = std::min(rows.begin, row);
        rows.end = row + 1;
        plot_.drawn_from_s = rows.begin == row ? time_s : plot_.drawn_from_s;
        plot_.drawn_to_s = time_s;
      }
    });
    if (rows.end < rows.begin + 2) {
      throw std::runtime_error("there are fewer than two cycles from " + in_seconds(from_s) +
                               " to " + in_seconds(to_s) + "; the recording goes from " +
                               in_seconds(begins_s_) + " to " + in_seconds(ends_s_) +
                               ", so choose --from and --to within that");
    }
    return rows;
  }

  // The points of the window, and the figures of all rows.
  void read_rows(const Rows& window) {
    const std::uint64_t rows = plot_.header.cycles;
    double last_cycle = 0.0;
    for (std::uint64_t first = 0; first < rows; first += kRowsAtOnce) {
      const Block block(reader_, std::min(kRowsAtOnce, rows - first), first);
      for (std::size_t i = 0; i < block.time_s.size(); ++i) {
        const std::uint64_t row = first + i;
        plot_.cycles_lost +=
            row == 0 ? 0 : static_cast<std::uint64_t>(block.cycle[i] - last_cycle - 1.0);
        last_cycle = block.cycle[i];
        plot_.missed_deadlines += static_cast<std::uint64_t>(block.missed[i]);
        plot_.period_max_us = std::max(plot_.period_max_us, block.period_us[i]);
        plot_.force_max_N = std::max(plot_.force_max_N, norm3(block.sent_N, 3 * i));
        if (row >= window.begin && row < window.end) {
          take(block, i, row - window.begin, (window.end - window.begin) / kPointsDrawn + 1);
        }
      }
    }
  }

  // Row `i` of a block, which is row `row` of the window.
  void take(const Block& block, std::size_t i, std::uint64_t row, std::uint64_t span) {
    if (row % span == 0) {
      Point point;
      point.time_s = block.time_s[i];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        point.position_mm[axis] = 1e3 * block.position_m[3 * i + axis];
      }
      point.asked_N = norm3(block.asked_N, 3 * plot_.header.method_names.size() * i);
      point.sent_N = norm3(block.sent_N, 3 * i);
      point.work_J = block.work_J[i];
      points_.push_back(point);
    }
    Point& point = points_.back();
    point.period_us = std::max(point.period_us, block.period_us[i]);
    point.wakeup_us = std::max(point.wakeup_us, block.wakeup_us[i]);
    point.compute_us = std::max(point.compute_us, block.compute_us[i]);
    point.report_age_ms = std::max(point.report_age_ms, 1e-3 * block.report_age_us[i]);
    point.sample_age_ms = std::max(point.sample_age_ms, block.sample_age_ms[i]);
  }

  const Hdf5Reader& reader_;
  const RecordingPlotOptions& options_;
  RecordingPlot plot_;
  double begins_s_ = 0.0;  // times of the first and the last cycle
  double ends_s_ = 0.0;
  std::vector<Point> points_;
};

}  // namespace

RecordingPlot plot_recording(const Hdf5Reader& reader, const std::string& folder,
                             const RecordingPlotOptions& options) {
  return Plotting(reader, options).draw_into(folder);
}

}  // namespace forcegrid::tools
