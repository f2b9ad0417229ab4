// SPDX-License-Identifier: Apache-2.0
#include "paper/report.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "evaluation/charts/page_text.h"
#include "evaluation/objects/force_table.h"
#include "paper/pictures.h"
#include "paper/tables.h"

namespace forcegrid::paper {
namespace {

namespace fs = std::filesystem;
using evaluation::escaped;
using evaluation::number;
using evaluation::readable;
using nlohmann::ordered_json;

ordered_json or_null(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json figures_json(const Figures& figures) {
  ordered_json fifths = ordered_json::array();
  for (const Fifth& fifth : figures.fifths) {
    ordered_json errors = ordered_json::object();
    for (std::size_t i = 0; i < figures.played.size(); ++i) {
      errors[figures.played[i].method] = or_null(fifth.rms_error_percent[i]);
    }
    fifths.push_back({{"begin_s", fifth.begin_s},
                      {"end_s", fifth.end_s},
                      {"top_speed_m_per_s", fifth.top_speed_m_per_s},
                      {"rms_error_percent", errors}});
  }
  return {{"scene", figures.motion.scene},
          {"motion", figures.motion.motion},
          {"offline_from_cache", figures.motion.from_cache},
          {"offline_solved_s", figures.motion.solved_s},
          {"offline_unconverged", figures.motion.unconverged},
          {"offline_branch_changes", figures.motion.branch_changes},
          {"offline_worst_seam_N", figures.motion.worst_seam_N},
          {"truth_rms_N", figures.played.front().verdict.reference_rms_N},
          {"blind_s", figures.blind_s},
          {"unfelt_N", figures.unfelt_N},
          {"fifths", fifths}};
}

ordered_json timing_json(const Timing& timing) {
  return {{"influence_radius_m", timing.influence_radius_m},
          {"vertices_within_r", timing.vertices_within_r},
          {"query_ns", timing.query_ns},
          {"bare_read_ns", timing.bare_read_ns},
          {"vertex_ns", timing.vertex_ns},
          {"fill_us", timing.fill_us},
          {"vertices_per_cycle", timing.vertices_per_cycle},
          {"vertices_per_answer", timing.vertices_per_answer},
          {"memory_bytes", timing.memory_bytes}};
}

ordered_json comparison_json(const Comparison& comparison) {
  ordered_json rows = ordered_json::array();
  for (const ComparisonRow& row : comparison.rows) {
    rows.push_back({{"scene", row.scene},
                    {"motion", row.motion},
                    {"method", row.method},
                    {"stands_for", row.stands_for},
                    {"needs", row.needs},
                    {"right_when", row.right_when},
                    {"rms_error_percent", or_null(row.error_percent)},
                    {"cycle_over_bare_read", or_null(row.cycle_over_bare_read)},
                    {"precompute_s", or_null(row.precompute_s)},
                    {"memory_MB", or_null(row.memory_MB)},
                    {"not_judged", row.not_judged}});
  }
  return {{"rows", rows}, {"which_to_take", comparison.which_to_take}};
}

ordered_json resolutions_json(const std::vector<ResolutionRow>& rows) {
  ordered_json list = ordered_json::array();
  for (const ResolutionRow& row : rows) {
    list.push_back({{"motion", row.motion},
                    {"vertices", row.vertices},
                    {"radius_m", row.radius_m},
                    {"radius_of_workspace", row.radius_of_workspace},
                    {"radius_over_travel", row.radius_over_travel},
                    {"spacing_over_radius", row.spacing_over_radius},
                    {"rms_error_percent", or_null(row.rms_error_percent)},
                    {"unknown_percent", row.unknown_percent},
                    {"fill_us", or_null(row.fill_us)},
                    {"memory_MB", row.memory_MB}});
  }
  return list;
}

ordered_json discrimination_json(const Discrimination& all) {
  ordered_json rows = ordered_json::array();
  for (const DiscriminationRow& row : all.rows) {
    rows.push_back({{"method", row.method},
                    {"knowledge", to_string(row.knowledge)},
                    {"weber_fraction", row.weber_fraction},
                    {"contrast", row.contrast},
                    {"trials", row.answers.trials},
                    {"right", row.answers.right},
                    {"percent", or_null(row.answers.percent())},
                    {"low_percent", row.answers.low_percent()},
                    {"high_percent", row.answers.high_percent()},
                    {"confusion", row.confusion}});
  }
  return {{"objects", all.objects},
          {"touch_s", all.touch_s},
          {"looks_per_s", all.noise.looks_per_s},
          {"floor_N", all.noise.floor_N},
          {"table_difference_percent", all.table_difference_percent},
          {"rows", rows}};
}

ordered_json shapes_json(const std::vector<ShapeDifference>& shapes) {
  ordered_json list = ordered_json::array();
  for (const ShapeDifference& each : shapes) {
    list.push_back({{"first", each.first},
                    {"second", each.second},
                    {"rms_mm", each.rms_mm},
                    {"largest_mm", each.largest_mm},
                    {"of_motion_percent", each.of_motion_percent},
                    {"d_prime", each.d_prime}});
  }
  return list;
}

std::string claims_html(const std::vector<Claim>& claims) {
  std::string html =
      "<table><thead><tr><th>topic<th>paper<th>here<th>outcome<th>criterion<th>difference and "
      "reason"
      "</tr></thead><tbody>";
  for (const Claim& claim : claims) {
    const char* const style = claim.outcome == Outcome::kAgrees    ? "met"
                              : claim.outcome == Outcome::kDiffers ? "missed"
                                                                   : "none";
    html += "<tr><td>" + escaped(claim.topic) + "<td>" + escaped(claim.paper) + "<td>" +
            escaped(claim.here) + "<td class=" + style + ">" + to_string(claim.outcome) + "<td>" +
            escaped(claim.rule) + "<td>" + escaped(claim.why) + "</tr>";
  }
  return html + "</tbody></table>";
}

// An HTML table with numbers rounded for people.
std::string table_html(const Table& table) {
  std::string html = "<table><thead><tr>";
  for (const std::string& name : table.columns) {
    html += "<th>" + escaped(name);
  }
  html += "</tr></thead><tbody>";
  for (const auto& row : table.rows) {
    html += "<tr>";
    for (const Cell& cell : row) {
      html += "<td>" + (cell.is_number ? readable(cell.number) : escaped(cell.text));
    }
    html += "</tr>";
  }
  return html + "</tbody></table>";
}

}  // namespace

std::string paper_json(const Results& results, const std::vector<Claim>& claims,
                       const PaperOptions& options) {
  ordered_json list = ordered_json::array();
  for (const Claim& claim : claims) {
    list.push_back({{"topic", claim.topic},
                    {"paper", claim.paper},
                    {"here", claim.here},
                    {"outcome", to_string(claim.outcome)},
                    {"rule", claim.rule},
                    {"why", claim.why}});
  }
  const ordered_json json{{"touches", options.plan.touches},
                          {"seed", options.seed},
                          {"elapsed_s", results.elapsed_s},
                          {"claims", list},
                          {"figures", figures_json(results.figures)},
                          {"timing", timing_json(results.timing)},
                          {"comparison", comparison_json(results.comparison)},
                          {"resolutions", resolutions_json(results.resolutions)},
                          {"discrimination", discrimination_json(results.discrimination)},
                          {"shapes", shapes_json(results.shapes)}};
  return json.dump(1) + '\n';
}

std::string paper_html(const Results& results, const std::vector<Claim>& claims,
                       const std::vector<std::string>& pictures) {
  const Figures& figures = results.figures;
  std::string html = evaluation::page_head("The forcegrid paper's experiments");
  html +=
      "<style>td{white-space:normal;text-align:left;vertical-align:top;max-width:26em}</style>"
      "<h1>The forcegrid paper's experiments</h1><p>Servo at 500 Hz, simulator at 30 Hz, each "
      "answer one period late. docs/paper.md explains each number and the observers' "
      "knowledge.</p><h2>The paper's figures and claims</h2>";
  html += claims_html(claims);
  html += "<h2>Figure 7</h2><p>" + escaped(figures.motion.scene_title) +
          ", held at its top. The reference force comes from solving the object at every servo "
          "instant; " +
          std::to_string(figures.motion.unconverged) + " of " +
          std::to_string(figures.motion.trace.servo.size()) +
          " did not reach a residual of 1e-6, " + std::to_string(figures.motion.branch_changes) +
          " were on another branch of equilibria.</p>" + evaluation::svg_element(pictures.at(0));
  html += "<h2>Figure 8</h2>" + evaluation::svg_element(pictures.at(1)) +
          table_html(fifths_table(figures));
  html +=
      "<h2>The methods that the paper names</h2><p>"
      "Errors are RMS after 1 s in % of the RMS force; costs are means per servo cycle, "
      "samples included, over the bare trilinear read of this run.";
  for (const std::string& sentence : results.comparison.which_to_take) {
    html += ' ' + escaped(sentence);
  }
  html += "</p>" + table_html(comparison_table(results.comparison));
  html += "<h2>Resolution and distance of influence</h2>" +
          evaluation::svg_element(pictures.at(2)) +
          table_html(resolutions_table(results.resolutions));
  html += "<h2>Discrimination of three objects</h2><p>Each trial lasts " +
          readable(results.discrimination.touch_s) +
          " s. Vertical lines are 95 % confidence intervals. The objects' forces come from tables "
          "of converged solutions, which differ from live solves by at most " +
          number(*std::max_element(results.discrimination.table_difference_percent.begin(),
                                   results.discrimination.table_difference_percent.end()),
                 "%.4f") +
          " % (RMS).</p>" + evaluation::svg_element(pictures.at(3)) +
          table_html(discrimination_table(results.discrimination));
  html +=
      "<h2>Visible differences of the objects</h2><p>Displacement of the surface's vertices, with "
      "the tool at the same five positions.</p>" +
      table_html(shapes_table(results.shapes));
  return html + "</body></html>\n";
}

std::vector<fs::path> write_report(const Results& results, const PaperOptions& options) {
  std::error_code failed;
  fs::create_directories(options.out, failed);
  if (failed) {
    throw evaluation::ChartError(options.out.string() + " can't be made: " + failed.message() +
                                 "; choose another folder with --out");
  }
  std::vector<fs::path> files;
  const auto write = [&](const char* name, const std::string& text) {
    files.push_back(options.out / name);
    evaluation::write_file(files.back(), text);
    return files.back();
  };
  const std::vector<Claim> claims = claims_of(results);
  write("claims.csv", csv(claims_table(claims)));
  const fs::path forces = write("figure7.csv", csv(forces_table(results.figures)));
  write("comparison.csv", csv(comparison_table(results.comparison)));
  write("resolutions.csv", csv(resolutions_table(results.resolutions)));
  write("discrimination.csv", csv(discrimination_table(results.discrimination)));
  write("shapes.csv", csv(shapes_table(results.shapes)));
  write("paper.json", paper_json(results, claims, options));
  const std::pair<const char*, std::function<void(const fs::path&)>> pictures[] = {
      {"figure7.svg", [&](const fs::path& file) { draw_figure_7(forces, results.figures, file); }},
      {"figure8.svg", [&](const fs::path& file) { draw_figure_8(forces, results.figures, file); }},
      {"resolutions.svg",
       [&](const fs::path& file) { draw_resolutions(results.resolutions, file); }},
      {"discrimination.svg",
       [&](const fs::path& file) { draw_discrimination(results.discrimination, file); }}};
  std::vector<std::string> drawn;
  for (const auto& [name, draw] : pictures) {
    files.push_back(options.out / name);
    draw(files.back());
    drawn.push_back(evaluation::read_text(files.back()));
  }
  write("index.html", paper_html(results, claims, drawn));
  return files;
}

}  // namespace forcegrid::paper
