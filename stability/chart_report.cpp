// SPDX-License-Identifier: Apache-2.0
#include "stability/chart_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "evaluation/charts/chart_html_parts.h"
#include "evaluation/charts/page_text.h"
#include "stability/chart_pictures.h"
#include "stability/chart_rows.h"
#include "stability/scenes.h"

namespace forcegrid::stability {
namespace {

using evaluation::escaped;
using evaluation::number;
using evaluation::readable;
using nlohmann::ordered_json;

ordered_json or_null(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

std::vector<std::string> column_names() {
  std::vector<std::string> names;
  const ordered_json row = to_json(StabilityRow{});
  for (auto entry = row.begin(); entry != row.end(); ++entry) {
    names.push_back(entry.key());
  }
  return names;
}

std::string field_of(const ordered_json& value) {
  if (value.is_null()) {
    return {};
  }
  if (value.is_string()) {
    return value.dump();
  }
  return value.is_number_float() ? number(value.get<double>(), "%.9g") : value.dump();
}

void add_numbers(std::string& html, const StabilityChart& chart, const std::string& method) {
  html +=
      "<h2>Goals</h2><p>Method <b>" + escaped(method) +
      "</b> unless a line says otherwise.</p><table class=sortable><thead><tr><th>figure<th>"
      "goal<th>measured<th>measured / goal<th>verdict<th class=words>worst at</tr></thead><tbody>";
  std::vector<std::string> others;
  for (const StabilityNumber& each : chart.numbers) {
    if (!each.known()) {
      others.push_back(each.name);
      continue;
    }
    const evaluation::GoalVerdict verdict =
        evaluation::goal_verdict(each.measured, each.goal, each.at_least);
    html += "<tr><td class=words>" + escaped(each.name) + "<td>" +
            (each.at_least ? "&ge; " : "&le; ") + number(each.goal) + ' ' + each.unit + "<td>" +
            readable(each.measured) + ' ' + each.unit + "<td>" + readable(each.ratio()) +
            "<td class=" + verdict.css_class + '>' + verdict.words + "<td class=words>" +
            escaped(each.worst) + "</tr>";
  }
  html += "</tbody></table>";
  if (!others.empty()) {
    html += evaluation::folded_list("Goals that are not in this selection", others);
  }
}

// So that no window is too narrow for the method that the page is about.
std::vector<SceneVerdict::Method> default_first(std::vector<SceneVerdict::Method> methods,
                                                const std::string& default_method) {
  std::stable_partition(methods.begin(), methods.end(), [&](const SceneVerdict::Method& each) {
    return each.method == default_method;
  });
  return methods;
}

void add_scenes(std::string& html, const StabilityChart& chart, const std::string& default_method) {
  const std::vector<SceneVerdict> verdicts = scene_verdicts(chart);
  if (verdicts.empty()) {
    return;
  }
  html +=
      "<h2>Scenes in which methods may fail</h2><p>Force error in % of RMS F<sub>o</sub>: closed "
      "loop at 200 "
      "N/m, "
      "worst of the hands and timings / open loop along a human motion. For an unstable loop, the "
      "kind of instability replaces the error. The default method, which comes first, and the best "
      "method of each scene are bold.</p><table class=tight><thead><tr>"
      "<th>scene<th>best";
  for (const SceneVerdict::Method& each : default_first(verdicts.front().methods, default_method)) {
    html += "<th>" + escaped(each.method);
  }
  html += "</tr></thead><tbody>";
  for (const SceneVerdict& verdict : verdicts) {
    html += "<tr><td title=\"" + escaped(scene_of(verdict.scene).title) + "\">" +
            escaped(verdict.scene) + "<td>" + escaped(verdict.best);
    for (const SceneVerdict::Method& each : default_first(verdict.methods, default_method)) {
      const bool stable = each.behaviour == Behaviour::kStable;
      const bool bold = each.method == verdict.best || each.method == default_method;
      html += std::string("<td") + (stable ? "" : " class=missed") + '>' + (bold ? "<b>" : "") +
              (stable ? readable(each.closed_loop_error_percent)
                      : std::string(to_string(each.behaviour))) +
              (bold ? "</b>" : "") + " <small>/ " + readable(each.open_loop_error_percent) +
              "</small>";
    }
    html += "</tr>";
  }
  html += "</tbody></table>";
}

std::string ends_of(const SweepLine& line) {
  std::string text;
  for (const auto& [name, count] : line.ended_by) {
    text += text.empty() ? "" : ", ";
    text += name;
    text += ' ';
    text += std::to_string(count);
  }
  return text;
}

// What could not be judged, by reason.
void add_not_judged(std::string& html, const StabilityChart& chart) {
  if (chart.not_judged.empty()) {
    return;
  }
  html += "<h2>Not judged</h2><p>" + std::to_string(chart.not_judged.size()) +
          " cells could not be judged. They count nowhere on this page.</p><table class=sortable>"
          "<thead><tr><th>cell<th>reason</tr></thead><tbody>";
  for (const NotJudgedCell& each : chart.not_judged) {
    html += "<tr><td>" + escaped(each.cell.text()) +
            "<td class=reason>not judged: " + escaped(each.reason) + "</tr>";
  }
  html += "</tbody></table>";
}

void add_sweep(std::string& html, const StabilityChart& chart) {
  if (chart.swept.empty()) {
    return;
  }
  html += "<h2>Fault sweep</h2><p>" + std::to_string(chart.sweep.size()) +
          " seeded runs of the real servo loop on emulated devices, with one fault each. The table "
          "counts the runs that continued, those that ended with zero current and why, and the two "
          "outcomes that must not occur.</p><table class=sortable>"
          "<thead><tr><th>device<th>fault<th>ended by<th>runs<th>continued<th>force above "
          "limit<th>more than 1 mJ afterwards<th>largest force / N<th>largest energy / mJ<th>its "
          "seed</tr></thead><tbody>";
  for (const SweepLine& line : chart.swept) {
    html += "<tr><td>" + escaped(line.device) + "<td>" + escaped(to_string(line.fault)) + "<td>" +
            escaped(ends_of(line)) + "<td>" + std::to_string(line.runs) + "<td>" +
            std::to_string(line.survivors) +
            (line.force_above_limit > 0 ? "<td class=missed>" : "<td>") +
            std::to_string(line.force_above_limit) +
            (line.energy_after_fault > 0 ? "<td class=missed>" : "<td>") +
            std::to_string(line.energy_after_fault) + "<td>" + readable(line.largest_force_N) +
            "<td>" + readable(1e3 * line.most_energy_J) + "<td>" + std::to_string(line.worst_seed) +
            "</tr>";
  }
  html += "</tbody></table>";
}

ordered_json sweep_json(const StabilityChart& chart) {
  ordered_json lines = ordered_json::array();
  for (const SweepLine& line : chart.swept) {
    ordered_json ends = ordered_json::object();
    for (const auto& [name, count] : line.ended_by) {
      ends[name] = count;
    }
    lines.push_back({{"device", line.device},
                     {"fault", to_string(line.fault)},
                     {"runs", line.runs},
                     {"survivors", line.survivors},
                     {"ended_by", std::move(ends)},
                     {"force_above_limit", line.force_above_limit},
                     {"energy_after_fault", line.energy_after_fault},
                     {"largest_force_N", or_null(line.largest_force_N)},
                     {"most_energy_J", or_null(line.most_energy_J)},
                     {"worst_seed", line.worst_seed}});
  }
  return lines;
}

std::string sweep_csv(const StabilityChart& chart) {
  std::string text =
      "device,fault,seed,method,hand,stiffness_N_per_m,fault_at_s,ended_by,largest_force_N,"
      "largest_drive_fraction,energy_after_fault_J,work_after_end_J\n";
  for (const SweptRun& run : chart.sweep) {
    text += run.device + ",\"";
    text += to_string(run.fault);
    text += "\"," + std::to_string(run.seed) + ",\"" + run.method + "\"," + run.hand + ',' +
            number(run.stiffness_N_per_m) + ',' + number(run.fault_at_s) + ',' +
            servo::name_of(run.ended_by) + ',' + number(run.largest_force_N) + ',' +
            number(run.largest_drive_fraction) + ',' + number(run.energy_after_fault_J) + ',' +
            number(run.work_after_end_J) + '\n';
  }
  return text;
}

}  // namespace

std::vector<SceneVerdict> scene_verdicts(const StabilityChart& chart) {
  std::vector<SceneVerdict> verdicts;
  for (const Scene& scene : scenes()) {
    SceneVerdict verdict;
    verdict.scene = scene.name;
    const auto method_of = [&](const std::string& name) -> SceneVerdict::Method& {
      for (SceneVerdict::Method& each : verdict.methods) {
        if (each.method == name) {
          return each;
        }
      }
      verdict.methods.push_back(
          {name, std::nan(""), std::nan(""), Behaviour::kStable, std::nan("")});
      return verdict.methods.back();
    };
    const auto exact_limit = [&](const StabilityCase& cell) {
      for (const StabilityRow& row : chart.rows) {
        if (row.cell.part == part::kScene && row.cell.scene == scene.name &&
            row.cell.method == kExact && row.cell.find_limit && row.cell.hand == cell.hand &&
            row.cell.timing == cell.timing) {
          return row.limit.largest_stable_N_per_m;
        }
      }
      return std::nan("");
    };
    for (const StabilityRow& row : chart.rows) {
      if (row.cell.scene != scene.name || row.cell.stiffness_N_per_m != 200.0) {
        continue;
      }
      if (row.cell.part == part::kOpen) {
        method_of(row.cell.method).open_loop_error_percent = row.run.force_error_percent;
      } else if (row.cell.part == part::kScene) {
        SceneVerdict::Method& each = method_of(row.cell.method);
        each.closed_loop_error_percent =
            std::fmax(each.closed_loop_error_percent, row.run.force_error_percent);
        if (each.behaviour == Behaviour::kStable) {
          each.behaviour = row.run.behaviour;
        }
        each.stiffness_ratio = std::fmin(each.stiffness_ratio,
                                         row.limit.largest_stable_N_per_m / exact_limit(row.cell));
      }
    }
    double least_percent = std::numeric_limits<double>::infinity();
    for (const SceneVerdict::Method& each : verdict.methods) {
      if (each.method != kExact && each.behaviour == Behaviour::kStable &&
          each.closed_loop_error_percent < least_percent) {
        least_percent = each.closed_loop_error_percent;
        verdict.best = each.method;
      }
    }
    if (!verdict.methods.empty()) {
      verdicts.push_back(std::move(verdict));
    }
  }
  return verdicts;
}

std::string stability_csv(const StabilityChart& chart) {
  std::string text;
  for (const std::string& name : column_names()) {
    text += (text.empty() ? "" : ",") + name;
  }
  text += '\n';
  for (const StabilityRow& row : chart.rows) {
    std::string line;
    for (const ordered_json& value : to_json(row)) {
      line += line.empty() ? "" : ",";
      line += field_of(value);
    }
    text += line + '\n';
  }
  return text;
}

std::string stability_json(const StabilityChart& chart, const StabilityChartOptions& options) {
  ordered_json json;
  json["default_method"] = options.default_method;
  json["seed"] = options.seed;
  json["scene"] = chart.scene;
  json["table_stiffness_N_per_m"] = chart.table_stiffness_N_per_m;
  json["elapsed_s"] = chart.elapsed_s;
  json["rows_kept"] = chart.rows_kept;
  json["hands"] = ordered_json::array();
  for (const Hand& hand : hands()) {
    json["hands"].push_back({{"name", hand.name},
                             {"mass_kg", hand.impedance.mass_kg},
                             {"damping_N_s_per_m", hand.impedance.damping_N_s_per_m},
                             {"stiffness_N_per_m", hand.impedance.stiffness_N_per_m},
                             {"source", hand.impedance.source}});
  }
  json["numbers"] = ordered_json::array();
  for (const StabilityNumber& each : chart.numbers) {
    json["numbers"].push_back({{"name", each.name},
                               {"goal", each.goal},
                               {"at_least", each.at_least},
                               {"measured", or_null(each.measured)},
                               {"ratio", or_null(each.ratio())},
                               {"unit", each.unit},
                               {"worst_at", each.worst},
                               {"met", each.known() ? ordered_json(each.met()) : nullptr}});
  }
  json["scenes"] = ordered_json::array();
  for (const SceneVerdict& verdict : scene_verdicts(chart)) {
    ordered_json methods = ordered_json::array();
    for (const SceneVerdict::Method& each : verdict.methods) {
      methods.push_back({{"method", each.method},
                         {"open_loop_error_percent", or_null(each.open_loop_error_percent)},
                         {"closed_loop_error_percent", or_null(each.closed_loop_error_percent)},
                         {"behaviour", to_string(each.behaviour)},
                         {"stiffness_ratio", or_null(each.stiffness_ratio)}});
    }
    json["scenes"].push_back({{"name", verdict.scene},
                              {"title", scene_of(verdict.scene).title},
                              {"best", verdict.best},
                              {"methods", std::move(methods)}});
  }
  json["not_judged"] = ordered_json::array();
  for (const NotJudgedCell& each : chart.not_judged) {
    json["not_judged"].push_back({{"cell", each.cell.text()}, {"reason", each.reason}});
  }
  json["sweep"] = sweep_json(chart);
  json["rows"] = ordered_json::array();
  for (const StabilityRow& row : chart.rows) {
    json["rows"].push_back(to_json(row));
  }
  return json.dump(1) + '\n';
}

std::string stability_html(const StabilityChart& chart, const StabilityChartOptions& options,
                           const std::vector<evaluation::LeadPicture>& lead,
                           const std::vector<std::string>& pictures) {
  std::string html = evaluation::page_head("Force methods: stability");
  html += "<h1>Force methods: stability in the closed loop</h1>" + evaluation::lead_pictures(lead) +
          "<p>" + std::to_string(chart.rows.size()) +
          " cells: device, hand, servo, method, simulator and link in simulated time, on the force "
          "table of <code>" +
          chart.scene +
          "</code> scaled to the stiffness K. Stable means: the tool stays within 50 mm of the "
          "hand's target, and after 6 s of motion and 2 s at rest it stays within 0.3 mm peak to "
          "peak for 2 s. "
          "<code>exact</code> is the object's force in every cycle, which <code>direct</code> "
          "renders.</p>";
  add_numbers(html, chart, options.default_method);
  add_scenes(html, chart, options.default_method);
  add_sweep(html, chart);
  add_not_judged(html, chart);
  html += pictures.empty() ? "" : "<h2>Pictures</h2><p>Dashed lines are theory.</p>";
  for (const std::string& picture : pictures) {
    html += evaluation::svg_element(picture);
  }
  const ordered_json names = column_names();
  ordered_json rows = ordered_json::array();
  for (const StabilityRow& row : chart.rows) {
    ordered_json line = ordered_json::array();
    for (const ordered_json& value : to_json(row)) {
      // Four digits are enough on the page; the CSV has all.
      line.push_back(value.is_number_float()
                         ? ordered_json::parse(number(value.get<double>(), "%.4g"))
                         : value);
    }
    rows.push_back(std::move(line));
  }
  html += evaluation::kHtmlAllRows;
  html += "<script>const names=" + names.dump() + ",rows=" + rows.dump() +
          ",filterColumns=11;</script>";
  return html + evaluation::kHtmlScript;
}

std::vector<std::filesystem::path> write_stability_chart(const StabilityChart& chart,
                                                         const StabilityChartOptions& options) {
  std::vector<std::filesystem::path> files;
  const auto write = [&](const char* name, const std::string& text) {
    files.push_back(options.out / name);
    evaluation::write_file(files.back(), text);
  };
  write("stability.csv", stability_csv(chart));
  if (!chart.sweep.empty()) {
    write("sweep.csv", sweep_csv(chart));
  }
  write("stability.json", stability_json(chart, options));
  std::vector<evaluation::LeadPicture> lead;
  std::vector<std::string> pictures;
  for (const std::filesystem::path& file :
       draw_pictures(chart, options.default_method, options.out)) {
    files.push_back(file);
    const std::string svg = evaluation::read_text(file);
    if (file.stem() == "delay_light_500Hz" || file.stem() == "delay_firm_500Hz") {
      lead.push_back({lead.empty() ? "Up to which stiffness?" : "And in another hand?",
                      "Below a curve the loop is stable. Dashed lines are theory.", svg});
    } else {
      pictures.push_back(svg);
    }
  }
  write("index.html", stability_html(chart, options, lead, pictures));
  return files;
}

}  // namespace forcegrid::stability
