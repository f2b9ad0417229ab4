// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "evaluation/charts/page_text.h"
#include "evaluation/charts/pair_chart.h"
#include "evaluation/files/text_file.h"
#include "evaluation/objects/force_table.h"

namespace forcegrid::evaluation {
namespace {

namespace fs = std::filesystem;

using Figures = std::vector<std::pair<const char*, double>>;

// The table's columns behind scene, pair, method and coupled.
Figures figures_of(const PairChartRow& row) {
  const PairVerdict& v = row.verdict;
  return {{"rms_error_percent_after_1s", v.together.after_1s.rms_percent},
          {"rms_error_percent_first_1s", v.together.first_1s.rms_percent},
          {"p95_error_percent_after_1s", v.together.after_1s.p95_percent},
          {"max_error_percent_after_1s", v.together.after_1s.max_percent},
          {"tool_1_rms_error_percent_after_1s", v.tools[0].after_1s.rms_percent},
          {"tool_2_rms_error_percent_after_1s", v.tools[1].after_1s.rms_percent},
          {"largest_step_N", v.together.largest_step_N},
          {"reference_rms_N", v.together.reference_rms_N},
          {"trilinear_read_ns", row.trilinear_read_ns},
          {"query_ns_median", v.query_ns_median},
          {"query_ns_p99", v.query_ns_p99},
          {"query_reads", row.query_reads()},
          {"sample_us_median", v.sample_us_median},
          {"sample_us_p99", v.sample_us_p99},
          {"cycle_ns", v.cycle_ns},
          {"memory_bytes", static_cast<double>(v.memory_bytes)}};
}

// Each once, in the order of the rows.
std::vector<std::string> distinct(const PairChart& chart, std::string PairChartRow::*member) {
  std::vector<std::string> values;
  for (const PairChartRow& row : chart.rows) {
    if (std::find(values.begin(), values.end(), row.*member) == values.end()) {
      values.push_back(row.*member);
    }
  }
  return values;
}

void write_table(const fs::path& file, const PairChart& chart) {
  TextWriter out(file.string());
  std::string header = "scene,pair,method,coupled";
  for (const auto& [name, value] : figures_of({})) {
    header += ',';
    header += name;
  }
  out.write(header + "\n");
  for (const PairChartRow& row : chart.rows) {
    std::string method = row.method;
    std::replace(method.begin(), method.end(), ',', ' ');
    std::string line = row.scene + "," + row.pair + "," + method + (row.coupled ? ",1" : ",0");
    for (const auto& [name, value] : figures_of(row)) {
      line += ',';
      line += number(value);
    }
    out.write(line + "\n");
  }
  out.finish();
}

nlohmann::ordered_json json_of(const PairChart& chart, const PairChartOptions& options) {
  using nlohmann::ordered_json;
  ordered_json json{{"seconds", options.seconds},
                    {"delay_s", options.delay_s},
                    {"noise_N", options.noise_N},
                    {"stiffness", options.stiffness},
                    {"seed", options.seed},
                    {"goals_for", options.goals_for},
                    {"unconverged_instants", chart.unconverged},
                    {"branch_changes", chart.branch_changes}};
  json["goals"] = ordered_json::array();
  for (const PairChartNumber& each : chart.numbers) {
    json["goals"].push_back({{"name", each.name},
                             {"measured", each.measured},
                             {"goal", each.goal},
                             {"unit", each.unit},
                             {"of", each.worst},
                             {"met", each.met()}});
  }
  json["rows"] = ordered_json::array();
  for (const PairChartRow& row : chart.rows) {
    ordered_json one{
        {"scene", row.scene}, {"pair", row.pair}, {"method", row.method}, {"coupled", row.coupled}};
    for (const auto& [name, value] : figures_of(row)) {
      one[name] = value;
    }
    json["rows"].push_back(one);
  }
  return json;
}

const PairChartRow* find(const PairChart& chart, const std::string& scene, const std::string& pair,
                         const std::string& method) {
  const auto found = std::find_if(chart.rows.begin(), chart.rows.end(), [&](const auto& row) {
    return row.scene == scene && row.pair == pair && row.method == method;
  });
  return found == chart.rows.end() ? nullptr : &*found;
}

// The largest of a method's figures on a scene.
template <typename Figure>
double largest(const PairChart& chart, const std::string& scene, const std::string& method,
               const Figure& figure) {
  double most = 0.0;
  for (const PairChartRow& row : chart.rows) {
    if (row.scene == scene && row.method == method) {
      most = std::max(most, figure(row));
    }
  }
  return most;
}

// Errors [%] of a scene: a line for each method, a column for each pair of motions.
std::string page_of(const PairChart& chart, const std::string& scene) {
  const std::vector<std::string> pairs = distinct(chart, &PairChartRow::pair);
  std::string text = "\n## " + scene + "\n\n| method |";
  std::string rule = "|---|";
  for (const std::string& pair : pairs) {
    text += " " + pair + " |";
    rule += "---|";
  }
  text += " geometric mean | query, bare reads | sample, us | memory, MB |\n" + rule +
          "---|---|---|---|\n";
  for (const std::string& method : distinct(chart, &PairChartRow::method)) {
    text += "| `" + method + "` |";
    for (const std::string& pair : pairs) {
      const PairChartRow* const row = find(chart, scene, pair, method);
      text += ' ';
      text += row == nullptr ? "" : readable(row->verdict.together.after_1s.rms_percent);
      text += " |";
    }
    const auto most = [&](const auto& figure) {
      return readable(largest(chart, scene, method, figure));
    };
    for (const std::string& figure :
         {readable(geometric_mean_percent(chart, scene, method)),
          most([](const PairChartRow& row) { return row.query_reads(); }),
          most([](const PairChartRow& row) { return row.verdict.sample_us_median; }),
          most([](const PairChartRow& row) {
            return 1e-6 * static_cast<double>(row.verdict.memory_bytes);
          })}) {
      text += ' ';
      text += figure;
      text += " |";
    }
    text += '\n';
  }
  return text;
}

void write_page(const fs::path& file, const PairChart& chart, const PairChartOptions& options) {
  std::string text =
      "# Two tools on one object\n\nRMS error of both forces together after 1 s, in % of their "
      "RMS. Query, sample and memory: of both tools, the largest over the pairs of motions.\n";
  text += "\n| " + options.goals_for + " | measured | goal | |\n|---|---|---|---|\n";
  for (const PairChartNumber& each : chart.numbers) {
    text += "| " + each.name + " | " + readable(each.measured) + " " + each.unit + " (" +
            each.worst + ") | " + readable(each.goal) + " " + each.unit + " | " +
            (each.known() ? goal_verdict(each.measured, each.goal, false).words
                          : "not in this selection") +
            " |\n";
  }
  for (const std::string& scene : distinct(chart, &PairChartRow::scene)) {
    text += page_of(chart, scene);
  }
  write_file(file, text);
}

}  // namespace

std::vector<fs::path> write_pair_chart(const PairChart& chart, const PairChartOptions& options) {
  const std::vector<fs::path> files{options.out / "two_tools.csv", options.out / "two_tools.json",
                                    options.out / "two_tools.md"};
  write_table(files[0], chart);
  write_file(files[1], json_of(chart, options).dump(2) + "\n");
  write_page(files[2], chart, options);
  return files;
}

}  // namespace forcegrid::evaluation
