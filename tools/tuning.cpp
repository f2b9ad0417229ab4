#include "tools/tuning.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <stdexcept>

#include "evaluation/gnuplot.h"

namespace forcegrid::tools {
namespace {

std::string percent(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g %%", value);
  return text;
}

std::string name_of(const TuningRow& row) {
  char text[64];
  std::snprintf(text, sizeof text, " at %.0f Hz, budget %d", row.rate_Hz, row.fill_budget);
  return row.method + text;
}

bool cheaper(const TuningRow& a, const TuningRow& b) {
  return a.processor_percent() != b.processor_percent()
             ? a.processor_percent() < b.processor_percent()
             : a.rate_Hz < b.rate_Hz;
}

// From zero to beyond the largest value; gnuplot has no range for values that are all alike.
std::string range(char axis, const std::vector<TuningRow>& rows,
                  double (*value)(const TuningRow&)) {
  double largest = 0.0;
  for (const TuningRow& row : rows) {
    largest = row.problem.empty() ? std::max(largest, value(row)) : largest;
  }
  char text[64];
  std::snprintf(text, sizeof text, "set %crange [0:%g]\n", axis,
                largest > 0.0 ? 1.3 * largest : 1.0);
  return text;
}

}  // namespace

std::string objection(const TuningRow& row, const TuningTolerance& tolerance) {
  if (!row.problem.empty()) {
    return row.problem;
  }
  if (!(row.error_percent <= tolerance.error_percent)) {
    return "error " + percent(row.error_percent) + " above " + percent(tolerance.error_percent);
  }
  if (!(row.missed_percent <= tolerance.missed_percent)) {
    return percent(row.missed_percent) + " of the deadlines missed, above " +
           percent(tolerance.missed_percent);
  }
  const double share = 1e-6 * row.compute_p99_us * row.rate_Hz;
  if (!(share <= tolerance.compute_share)) {
    return "one cycle in a hundred computes for " + percent(100.0 * share) +
           " of its period, above " + percent(100.0 * tolerance.compute_share);
  }
  return "";
}

TuningChoice choose(const std::vector<TuningRow>& rows, const TuningTolerance& tolerance) {
  TuningChoice choice;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (objection(rows[i], tolerance).empty() &&
        (!choice.chosen || cheaper(rows[i], rows[*choice.chosen]))) {
      choice.chosen = i;
    }
  }
  if (!choice.chosen) {
    const auto best =
        std::min_element(rows.begin(), rows.end(), [](const TuningRow& a, const TuningRow& b) {
          return std::make_pair(!a.problem.empty(), a.error_percent) <
                 std::make_pair(!b.problem.empty(), b.error_percent);
        });
    choice.reason = "no setting meets the tolerance";
    if (best != rows.end()) {
      choice.reason += "; nearest: " + name_of(*best) + " (" + objection(*best, tolerance) + ")";
    }
    return choice;
  }
  const TuningRow& chosen = rows[*choice.chosen];
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].problem.empty() && cheaper(rows[i], chosen) &&
        (!choice.next_cheaper || cheaper(rows[*choice.next_cheaper], rows[i]))) {
      choice.next_cheaper = i;
    }
  }
  choice.reason = name_of(chosen) + " meets the tolerance for " +
                  percent(chosen.processor_percent()) + " of a processor, with an error of " +
                  percent(chosen.error_percent) + "; ";
  choice.reason += choice.next_cheaper ? "next cheaper is " + name_of(rows[*choice.next_cheaper]) +
                                             ": " + objection(rows[*choice.next_cheaper], tolerance)
                                       : "nothing that was tried is cheaper";
  return choice;
}

std::vector<std::string> draw_tuning(const std::string& folder, const std::vector<TuningRow>& rows,
                                     const TuningChoice& choice) {
  const std::string csv = folder + "/tuning.csv";
  std::ofstream stream(csv);
  stream << "rate_Hz,error_percent,missed_percent,processor_percent,chosen,fill_budget,"
            "period_p99_us,compute_p50_us,compute_p99_us,backlog_percent,method\n";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const TuningRow& r = rows[i];
    if (r.problem.empty()) {
      stream << r.rate_Hz << ',' << r.error_percent << ',' << r.missed_percent << ','
             << r.processor_percent() << ',' << (choice.chosen == i ? 1 : 0) << ',' << r.fill_budget
             << ',' << r.period_p99_us << ',' << r.compute_p50_us << ',' << r.compute_p99_us << ','
             << r.backlog_percent << ",\"" << r.method << "\"\n";
    }
  }
  stream.close();
  if (!stream) {
    throw std::runtime_error(csv + " can't be written; choose another folder with --out");
  }
  const std::string data = evaluation::quoted(csv);
  using Column = double (*)(const TuningRow&);
  constexpr Column columns[] = {[](const TuningRow& r) { return r.rate_Hz; },
                                [](const TuningRow& r) { return r.error_percent; },
                                [](const TuningRow& r) { return r.missed_percent; },
                                [](const TuningRow& r) { return r.processor_percent(); }};
  const auto panel = [&](int x, int y, const std::string& axes) {
    const std::string at = std::to_string(x) + ":" + std::to_string(y);
    return axes + range('x', rows, columns[x - 1]) + range('y', rows, columns[y - 1]) + "plot " +
           data + " using " + at + " with points pt 6 title '', " + data + " using " + at +
           ":11 with labels left offset 0.7,0.2 font ',9' title '', " + data + " using " +
           std::to_string(x) + ":($5 == 1 ? $" + std::to_string(y) +
           " : NaN) with points pt 7 ps 1.6 lc rgb '#D55E00' title 'chosen'\n";
  };
  std::string script =
      "set datafile separator ','\nset grid\nset key outside top right\nset offsets 0,graph "
      "0.2,0,0\n";
  for (const bool svg : {true, false}) {
    script += svg ? "set terminal svg size 900,1200 background '#ffffff' font 'sans,12'\n"
                  : "set terminal pngcairo size 900,1200 background '#ffffff' font 'sans,11'\n";
    script += "set output " + evaluation::quoted(folder + (svg ? "/tuning.svg" : "/tuning.png")) +
              "\nset multiplot layout 3,1\n" +
              panel(1, 2, "set xlabel 'rate / Hz'\nset ylabel 'error / %'\n") +
              panel(1, 3, "set ylabel 'deadlines missed / %'\n") +
              panel(4, 2, "set xlabel 'processor time / %'\nset ylabel 'error / %'\n") +
              "unset multiplot\n";
  }
  evaluation::run_gnuplot(script, folder + "/tuning.svg");
  return {csv, folder + "/tuning.svg", folder + "/tuning.png"};
}

}  // namespace forcegrid::tools
