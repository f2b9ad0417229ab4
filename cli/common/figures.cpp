// SPDX-License-Identifier: Apache-2.0
#include "cli/common/figures.h"

#include <iomanip>
#include <ostream>

#include "evaluation/files/gnuplot.h"
#include "text/output_file.h"

namespace forcegrid::cli {
namespace {

std::string data_file(const std::string& directory) { return directory + "/forces.csv"; }

bool has_references(const std::vector<FigureRow>& rows) {
  return !rows.empty() && rows.front().reference_W_N.has_value();
}

void write_triple(std::ostream& file, const Triple& t) {
  file << ',' << t[0] << ',' << t[1] << ',' << t[2];
}

constexpr int kReferenceStyle = 9;

// gnuplot's text for one curve of column `column`, negated: the paper plots the force that the
// hand exerts against the object's pull, positive in the direction of the tool.
std::string force_curve(const std::string& data, int column, const std::string& title, int style) {
  return data + " using 1:(-$" + std::to_string(column) + ") with lines ls " +
         std::to_string(style) + " title '" + title + "'";
}

std::string error_curve(const std::string& data, int method_column, int reference_column,
                        const std::string& title, int style) {
  std::string squares;
  for (int axis = 0; axis < 3; ++axis) {
    squares += std::string(axis == 0 ? "" : "+") + "($" + std::to_string(method_column + axis) +
               "-$" + std::to_string(reference_column + axis) + ")**2";
  }
  return data + " using 1:(sqrt(" + squares + ")) with lines ls " + std::to_string(style) +
         " title '" + title + "'";
}

std::string label_of(const std::string& method) {
  return method == "hold" ? "streaming (hold)" : method;
}

}  // namespace

std::string write_figure_data(const std::string& directory,
                              const std::vector<std::string>& method_names,
                              const std::vector<FigureRow>& rows) {
  const std::string csv = data_file(directory);
  const bool has_reference = has_references(rows);
  text::OutputFile output(csv);
  std::ostream& file = output.stream();
  file << "time_s,x_m,y_m,z_m";
  if (has_reference) {
    file << ",offline_x_N,offline_y_N,offline_z_N";
  }
  for (const std::string& name : method_names) {
    file << ',' << name << "_x_N," << name << "_y_N," << name << "_z_N";
  }
  file << '\n' << std::setprecision(9);
  for (const FigureRow& row : rows) {
    file << row.time_s;
    write_triple(file, row.position_W_m);
    if (has_reference) {
      write_triple(file, row.reference_W_N.value_or(Triple{}));
    }
    for (const Triple& force : row.method_W_N) {
      write_triple(file, force);
    }
    file << '\n';
  }
  output.finish();
  return csv;
}

std::vector<std::string> draw_figures(const std::string& directory,
                                      const std::vector<std::string>& method_names,
                                      const std::vector<FigureRow>& rows) {
  if (rows.size() < 2) {
    return {};
  }
  const std::string csv = data_file(directory);
  const bool has_reference = has_references(rows);

  // More points than pixels would only enlarge the files.
  constexpr std::size_t kPointsDrawn = 3000;
  const std::string data =
      evaluation::quoted(csv) + " every " + std::to_string(rows.size() / kPointsDrawn + 1);

  constexpr int kFirstForceColumn = 5;
  // The reference first, wide and grey: an accurate method hides nothing, but lies upon it.
  std::string forces =
      has_reference ? force_curve(data, kFirstForceColumn + 2, "reference", kReferenceStyle) : "";
  std::string errors;
  int column = kFirstForceColumn + (has_reference ? 3 : 0);
  int style = 2;
  // Streaming first, so that it lies below the accurate curves.
  for (std::size_t i = method_names.size(); i-- > 0; ++style) {
    const int method_column = column + 3 * static_cast<int>(i);
    forces += (forces.empty() ? "" : ", ") +
              force_curve(data, method_column + 2, label_of(method_names[i]), style);
    errors += (errors.empty() ? "" : ", ") +
              error_curve(data, method_column, kFirstForceColumn, label_of(method_names[i]), style);
  }
  const char* const panels = has_reference ? "3" : "2";
  std::string script =
      "set datafile separator ','\n"
      "set style line 1 lc rgb '#000000' lw 1.2\n"
      "set style line 2 lc rgb '#E69F00' lw 1.2\n"
      "set style line 3 lc rgb '#0072B2' lw 1.2\n"
      "set style line 4 lc rgb '#009E73' lw 1.2\n"
      "set style line 5 lc rgb '#CC79A7' lw 1.2\n"
      "set style line 9 lc rgb '#BBBBBB' lw 6\n"
      "set grid lt 1 lw 0.5 lc rgb '#dddddd'\nset key outside top center horizontal samplen 2\n"
      "set lmargin 9\nset rmargin 3\n"
      "set ytics nomirror\nset xtics nomirror\nset border 3\n"
      "set xrange [0:" +
      std::to_string(rows.back().time_s) + "]\n";
  for (const bool svg : {true, false}) {
    script += svg ? "set terminal svg size 1000,900 background '#ffffff' font 'sans,13'\n"
                  : "set terminal pngcairo size 1000,900 background '#ffffff' font 'sans,11'\n";
    script += "set output " +
              evaluation::quoted(directory + (svg ? "/forces.svg" : "/forces.png")) + "\n";
    script += std::string("set multiplot layout ") + panels + ",1\n";
    script +=
        "unset xlabel\nset ylabel 'tool along the normal / mm'\n"
        "plot " +
        data + " using 1:(1000*$4) with lines ls 1 title 'position'\n";
    script += has_reference ? "" : "set xlabel 'time since contact / s'\n";
    script += "set ylabel 'pull along the normal / N'\nplot " + forces + "\n";
    if (has_reference) {
      // Methods differ by orders of magnitude.
      script +=
          "set xlabel 'time since contact / s'\nset ylabel '|F - F_{ref}| / N'\n"
          "set logscale y\nset format y '10^{%T}'\nset yrange [1e-5:*]\nplot " +
          errors + "\nunset logscale y\nset format y\nset yrange [*:*]\n";
    }
    script += "unset multiplot\n";
  }
  evaluation::run_gnuplot(script, {directory + "/forces.svg", directory + "/forces.png"});
  return {directory + "/forces.svg", directory + "/forces.png"};
}

}  // namespace forcegrid::cli
