// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "evaluation/charts/chart_html_parts.h"
#include "evaluation/charts/chart_plot.h"
#include "evaluation/charts/chart_requests.h"
#include "evaluation/charts/chart_rows.h"
#include "evaluation/charts/chart_summary.h"
#include "evaluation/charts/page_text.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/scenarios.h"

namespace forcegrid::evaluation {
namespace {

using nlohmann::ordered_json;

// Of the first screen's pictures: two of them side by side in a window of 1300 pixels.
constexpr double kLeadWidth_px = 640.0;
constexpr double kLeadHeight_px = 520.0;

ordered_json or_null(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json to_json(const TableDifference& difference) {
  return {{"positions", difference.positions},
          {"rms_percent", difference.rms_percent},
          {"max_N", difference.max_N},
          {"live_rms_N", difference.live_rms_N},
          {"unconverged", difference.unconverged},
          {"branch_changes", difference.branch_changes}};
}

void add_numbers(std::string& html, const Chart& chart, const ChartOptions& options) {
  html += "<h2>Goals</h2><p>Method <b>" + escaped(options.default_method) +
          "</b>; the names of costs include their method. The bare trilinear read, the baseline "
          "for queries, took " +
          readable(chart.bare_trilinear_read_ns) + " ns.";
  html += chart.numbers.empty() ? "" : " Scene: " + escaped(chart.numbers.front().scene) + '.';
  html +=
      "</p><table class=sortable><thead><tr><th>figure<th>goal<th>measured<th>measured / goal"
      "<th>verdict<th class=words>worst at</tr></thead><tbody>";
  std::vector<std::string> others;
  for (const ChartNumber& each : chart.numbers) {
    if (!each.known()) {
      others.push_back(each.name);
      continue;
    }
    const GoalVerdict verdict = goal_verdict(each.measured, each.goal, false);
    html += "<tr><td>" + escaped(each.name) + "<td>&le; " + number(each.goal) + ' ' + each.unit +
            "<td>" + readable(each.measured) + ' ' + each.unit + "<td>" + readable(each.ratio()) +
            "<td class=" + verdict.css_class + '>' + verdict.words + "<td>" + escaped(each.worst) +
            "</tr>";
  }
  html += "</tbody></table>";
  if (!others.empty()) {
    html += folded_list("Goals that are not in this selection", others);
  }
}

const NotJudged* not_judged_row(const Chart& chart, const std::string& scene,
                                const std::string& trajectory, const ChartPoint& point) {
  const auto found =
      std::find_if(chart.not_judged.begin(), chart.not_judged.end(), [&](const NotJudged& each) {
        return each.scene == scene && each.trajectory == trajectory &&
               each.condition == point.condition && each.method == point.method;
      });
  return found == chart.not_judged.end() ? nullptr : &*found;
}

// What could not be judged, by reason.
void add_not_judged(std::string& html, const Chart& chart) {
  if (chart.not_judged.empty()) {
    return;
  }
  html += "<h2>Not judged</h2><p>" + std::to_string(chart.not_judged.size()) +
          " rows could not be judged. They count nowhere on this page.</p><table class=sortable>"
          "<thead><tr><th>scene<th>motion<th>condition<th>method<th>reason</tr></thead><tbody>";
  for (const NotJudged& each : chart.not_judged) {
    html += "<tr><td>" + escaped(each.scene) + "<td>" + escaped(each.trajectory) + "<td>" +
            escaped(each.condition) + "<td>" + escaped(each.method) +
            "<td class=reason>not judged: " + escaped(each.reason) + "</tr>";
  }
  html += "</tbody></table>";
}

void add_scene(std::string& html, const Chart& chart, const ChartTable& table,
               const std::string& picture) {
  html +=
      "<h2>" + escaped(table.scene) + "</h2><p>" + escaped(table.title) +
      ". Normal stiffness at rest: " + readable(table.stiffness_N_per_m) +
      " N/m. Forces come from a table of converged solutions, which differs from live solves by " +
      number(table.along_motion.rms_percent, "%.4f") + " % (RMS) at " +
      std::to_string(table.along_motion.positions) + " positions along a motion and by " +
      number(table.at_random.rms_percent, "%.4f") + " % at " +
      std::to_string(table.at_random.positions) + " random ones.";
  if (table.direct_cycle_us > 0.0) {
    html += " One cycle of <code>direct</code> takes " + readable(table.direct_cycle_us) +
            " &micro;s (median, measured live).";
  }
  html += "</p>" + svg_element(picture);
  const std::vector<ChartPoint> points = points_of(chart, table.scene);
  std::vector<std::string> trajectories;
  for (const std::string& name : trajectory_names()) {
    if (std::any_of(chart.rows.begin(), chart.rows.end(), [&](const ChartRow& row) {
          return row.scene == table.scene && row.trajectory == name;
        })) {
      trajectories.push_back(name);
    }
  }
  html +=
      "<p>RMS error after the first second / within it, in % of RMS F<sub>o</sub>; cost and "
      "memory.</p>"
      "<table class=sortable><thead><tr><th>method<th>condition";
  for (const std::string& name : trajectories) {
    html += "<th>" + escaped(name);
  }
  html +=
      "<th>static, geometric mean<th>cycle ns<th>query ns<th>sample &micro;s<th>memory kB"
      "<th>pre-computation s"
      "</tr></thead><tbody>";
  for (const ChartPoint& point : points) {
    html += std::string("<tr") + (point.on_front ? " class=front" : "") + "><td>" +
            escaped(point.method) + "<td>" + escaped(point.condition);
    const ChartRow* shown = nullptr;
    for (const std::string& name : trajectories) {
      const auto row =
          std::find_if(chart.rows.begin(), chart.rows.end(), [&](const ChartRow& each) {
            return each.scene == table.scene && each.trajectory == name &&
                   each.condition == point.condition && each.method == point.method;
          });
      if (row == chart.rows.end()) {
        const NotJudged* const not_judged = not_judged_row(chart, table.scene, name, point);
        html += not_judged == nullptr
                    ? "<td>"
                    : "<td class=none title=\"" + escaped(not_judged->reason) + "\">not judged";
        continue;
      }
      html += "<td>" + readable(row->verdict.rms_error_percent_after_1s) + " <small>/ " +
              readable(row->verdict.rms_error_percent_first_1s) + "</small>";
      shown = &*row;
    }
    html += "<td>" + readable(point.error_percent) + "<td>" + readable(point.cycle_ns);
    html += "<td>" + (shown ? readable(shown->verdict.query_ns_median) : "") + "<td>" +
            (shown ? readable(shown->verdict.sample_us_median) : "") + "<td>" +
            (shown ? readable(1e-3 * static_cast<double>(shown->verdict.memory_bytes)) : "") +
            "<td>" +
            (shown && std::isfinite(shown->precompute_s) ? readable(shown->precompute_s) : "") +
            "</tr>";
  }
  html += "</tbody></table>" + requests_html(chart, table.scene);
}

// As CSV has them in a quoted field.
std::string doubled_quotes(const std::string& text) {
  std::string result;
  for (const char character : text) {
    result += character == '"' ? std::string("\"\"") : std::string(1, character);
  }
  return result;
}

}  // namespace

std::string chart_csv(const Chart& chart) {
  std::string text = "scene,trajectory,condition,method";
  for (const RowFigure& figure : figures_of(ChartRow{})) {
    text += std::string(",") + figure.first;
  }
  text += ",not_judged\n";
  for (const ChartRow& row : chart.rows) {
    text += row.scene + ',' + row.trajectory + ',' + row.condition + ",\"" + row.method + '"';
    for (const RowFigure& figure : figures_of(row)) {
      text += ',' + number(figure.second, "%.9g");
    }
    text += ",\n";
  }
  const std::string no_figures(figures_of(ChartRow{}).size(), ',');
  for (const NotJudged& each : chart.not_judged) {
    text += each.scene + ',' + each.trajectory + ',' + each.condition + ",\"" + each.method + '"' +
            no_figures + ",\"" + doubled_quotes(each.reason) + "\"\n";
  }
  return text;
}

std::string chart_json(const Chart& chart, const ChartOptions& options) {
  ordered_json json;
  json["default_method"] = options.default_method;
  json["seed"] = options.seed;
  json["servo_rate_Hz"] = kChartServoRate_Hz;
  json["elapsed_s"] = chart.elapsed_s;
  json["rows_kept"] = chart.rows_kept;
  json["scenes"] = ordered_json::array();
  for (const ChartTable& table : chart.tables) {
    json["scenes"].push_back(
        {{"name", table.scene},
         {"title", table.title},
         {"table_key", table.key},
         {"table_from_cache", table.from_cache},
         {"table_solved_s", table.solved_s},
         {"stiffness_N_per_m", table.stiffness_N_per_m},
         {"difference_along_motion", to_json(table.along_motion)},
         {"difference_at_random", to_json(table.at_random)},
         {"direct_cycle_us",
          or_null(table.direct_cycle_us > 0.0 ? table.direct_cycle_us : std::nan(""))}});
  }
  json["bare_trilinear_read_ns"] = chart.bare_trilinear_read_ns;
  json["numbers"] = ordered_json::array();
  for (const ChartNumber& each : chart.numbers) {
    json["numbers"].push_back({{"name", each.name},
                               {"scene", each.scene},
                               {"goal", each.goal},
                               {"measured", or_null(each.measured)},
                               {"ratio", or_null(each.ratio())},
                               {"unit", each.unit},
                               {"worst_at", each.worst},
                               {"met", each.known() ? ordered_json(each.met()) : nullptr}});
  }
  json["points"] = ordered_json::array();
  for (const ChartTable& table : chart.tables) {
    for (const ChartPoint& point : points_of(chart, table.scene)) {
      json["points"].push_back({{"scene", table.scene},
                                {"method", point.method},
                                {"condition", point.condition},
                                {"error_percent", or_null(point.error_percent)},
                                {"cycle_ns", or_null(point.cycle_ns)},
                                {"on_front", point.on_front}});
    }
  }
  json["by_requests"] = ordered_json::array();
  for (const ChartTable& table : chart.tables) {
    for (const RequestRow& row : requests_of(chart, table.scene)) {
      ordered_json errors = ordered_json::array();
      for (const double error_percent : row.error_percent) {
        errors.push_back(or_null(error_percent));
      }
      json["by_requests"].push_back({{"scene", table.scene},
                                     {"method", row.method},
                                     {"trajectory", row.trajectory},
                                     {"figure", row.figure},
                                     {"requests_per_s", kRequestRates_per_s},
                                     {"error_percent", errors},
                                     {"answers", row.answers}});
    }
  }
  json["not_judged"] = ordered_json::array();
  for (const NotJudged& each : chart.not_judged) {
    json["not_judged"].push_back({{"scene", each.scene},
                                  {"trajectory", each.trajectory},
                                  {"condition", each.condition},
                                  {"method", each.method},
                                  {"reason", each.reason}});
  }
  json["not_run"] = ordered_json::array();
  for (const NotRun& each : chart.not_run) {
    json["not_run"].push_back({{"method", each.method}, {"reason", each.reason}});
  }
  json["rows"] = ordered_json::array();
  for (const ChartRow& row : chart.rows) {
    json["rows"].push_back(to_json(row));
  }
  return json.dump(1) + '\n';
}

std::string chart_html(const Chart& chart, const ChartOptions& options,
                       const std::vector<LeadPicture>& lead,
                       const std::vector<std::string>& pictures,
                       const std::vector<ChartFigure>& figures) {
  std::string html = page_head("Force methods: accuracy against speed");
  html +=
      "<h1>Force methods: accuracy against speed</h1>" + lead_pictures(lead) + "<p>" +
      std::to_string(chart.rows.size()) +
      " rows. Each row is one method on one object, motion and network, with the servo at 500 Hz. "
      "Errors are |F - F<sub>o</sub>| in % of the RMS of |F<sub>o</sub>|, where F<sub>o</sub> is "
      "the reference force: that of the converged object. Click a column's heading to sort.</p>";
  add_numbers(html, chart, options);
  for (std::size_t i = 0; i < chart.tables.size(); ++i) {
    add_scene(html, chart, chart.tables[i], i < pictures.size() ? pictures[i] : std::string());
  }
  if (!figures.empty()) {
    html += "<h2>The paper's figures 7 and 8</h2>";
    for (const ChartFigure& figure : figures) {
      html += "<h3>" + escaped(figure.title) + "</h3>" + svg_element(figure.svg);
    }
  }
  add_not_judged(html, chart);
  if (!chart.not_run.empty()) {
    html += "<h2>Not run</h2><ul>";
    for (const NotRun& each : chart.not_run) {
      html += "<li>" + escaped(each.method) + ": " + escaped(each.reason);
    }
    html += "</ul>";
  }
  ordered_json names = {"scene", "trajectory", "condition", "method"};
  for (const RowFigure& figure : figures_of(ChartRow{})) {
    names.push_back(figure.first);
  }
  names.push_back("not_judged");
  ordered_json rows = ordered_json::array();
  for (const ChartRow& row : chart.rows) {
    ordered_json line = {row.scene, row.trajectory, row.condition, row.method};
    for (const RowFigure& figure : figures_of(row)) {
      // Four digits are enough on the page; the CSV has all.
      const std::string text = number(figure.second, "%.4g");
      line.push_back(text.empty() ? ordered_json(nullptr) : ordered_json::parse(text));
    }
    line.push_back("");
    rows.push_back(std::move(line));
  }
  for (const NotJudged& each : chart.not_judged) {
    ordered_json line = {each.scene, each.trajectory, each.condition, each.method};
    line.insert(line.end(), figures_of(ChartRow{}).size(), ordered_json(nullptr));
    line.push_back(each.reason);
    rows.push_back(std::move(line));
  }
  html += kHtmlAllRows;
  html +=
      "<script>const names=" + names.dump() + ",rows=" + rows.dump() + ",filterColumns=4;</script>";
  return html + kHtmlScript;
}

std::vector<std::filesystem::path> write_chart(const Chart& chart, const ChartOptions& options,
                                               const std::vector<ChartFigure>& figures,
                                               const std::vector<LeadPicture>& more) {
  std::vector<std::filesystem::path> files;
  const auto write = [&](const char* name, const std::string& text) {
    files.push_back(options.out / name);
    write_file(files.back(), text);
  };
  write("accuracy.csv", chart_csv(chart));
  write("accuracy.json", chart_json(chart, options));
  std::vector<std::string> pictures;
  for (const ChartTable& table : chart.tables) {
    const std::filesystem::path svg =
        options.out / ("error_against_cost_" + file_name_part(table.scene) + ".svg");
    pictures.emplace_back();
    if (write_error_cost_svg(svg, table.scene + ": " + table.title,
                             points_of(chart, table.scene))) {
      files.push_back(svg);
      pictures.back() = read_text(svg);
    }
  }
  std::vector<LeadPicture> lead;
  const std::filesystem::path svg = options.out / "error_against_cost.svg";
  std::string scene = chart.numbers.empty() ? "" : chart.numbers.front().scene;
  if (scene.empty() && !chart.tables.empty()) {
    scene = chart.tables.back().scene;  // an object that has no goals
  }
  std::string title = scene;
  for (const ChartTable& table : chart.tables) {
    title += table.scene == scene ? ": " + table.title : "";
  }
  if (write_error_cost_svg(svg, title, points_of(chart, scene),
                           {.width_px = kLeadWidth_px,
                            .height_px = kLeadHeight_px,
                            .labelled = {options.default_method, "hold", "forcegrid"}})) {
    files.push_back(svg);
    lead.push_back({"How accurate, at what cost?",
                    "Object " + scene +
                        ", static motions. Down is more accurate, left is faster. Every method "
                        "has its label in the picture of the object below.",
                    read_text(svg)});
  }
  lead.insert(lead.end(), more.begin(), more.end());
  write("index.html", chart_html(chart, options, lead, pictures, figures));
  return files;
}

}  // namespace forcegrid::evaluation
