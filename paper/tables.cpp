// SPDX-License-Identifier: Apache-2.0
#include "paper/tables.h"

#include <cmath>

#include "evaluation/charts/page_text.h"
#include "evaluation/motions/trajectories.h"
#include "paper/pictures.h"

namespace forcegrid::paper {
namespace {

// In quotation marks, with those inside doubled.
std::string in_quotes(const std::string& text) {
  std::string result = "\"";
  for (const char character : text) {
    result += character == '"' ? std::string("\"\"") : std::string(1, character);
  }
  return result + '"';
}

double count(std::size_t number) { return static_cast<double>(number); }

}  // namespace

std::string csv(const Table& table) {
  std::string text;
  for (const std::string& name : table.columns) {
    text += (text.empty() ? "" : ",") + name;
  }
  text += '\n';
  for (const auto& row : table.rows) {
    bool first = true;
    for (const Cell& cell : row) {
      text += first ? "" : ",";
      text += cell.is_number ? evaluation::number(cell.number, "%.9g") : in_quotes(cell.text);
      first = false;
    }
    text += '\n';
  }
  return text;
}

Table claims_table(const std::vector<Claim>& claims) {
  Table table{{"topic", "paper", "here", "outcome", "agrees_when", "what_differs_and_why"}, {}};
  for (const Claim& claim : claims) {
    table.rows.push_back({claim.topic, claim.paper, claim.here,
                          std::string(to_string(claim.outcome)), claim.rule, claim.why});
  }
  return table;
}

Table forces_table(const Figures& figures) {
  Table table{{"time_s", "tool_mm", "offline_N"}, {}};
  for (const Played& played : figures.played) {
    table.columns.push_back(played.method + "_N");
  }
  const auto& servo = figures.motion.trace.servo;
  for (std::size_t i = 0; i < servo.size(); ++i) {
    std::vector<Cell> row{servo[i].time_s,
                          1e3 * (servo[i].position_W - evaluation::first_contact_point_W()).z(),
                          -servo[i].force_W.z()};
    for (const Played& played : figures.played) {
      row.emplace_back(-played.verdict.forces_W[i].z());
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table fifths_table(const Figures& figures) {
  Table table{{"from_s", "to_s", "top_speed_mm_per_s"}, {}};
  for (const Played& played : figures.played) {
    table.columns.push_back(label_of(played.method) + ", RMS error %");
  }
  for (const Fifth& fifth : figures.fifths) {
    std::vector<Cell> row{fifth.begin_s, fifth.end_s, 1e3 * fifth.top_speed_m_per_s};
    for (const double percent : fifth.rms_error_percent) {
      row.emplace_back(percent);
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table comparison_table(const Comparison& comparison) {
  Table table{
      {"scene", "motion", "method", "stands_for", "needs", "right_when", "rms_error_percent",
       "cycle_over_bare_read", "precompute_s", "memory_MB", "not_judged"},
      {}};
  for (const ComparisonRow& row : comparison.rows) {
    table.rows.push_back({row.scene, row.motion, row.method, row.stands_for, row.needs,
                          row.right_when, row.error_percent, row.cycle_over_bare_read,
                          row.precompute_s, row.memory_MB, row.not_judged});
  }
  return table;
}

Table resolutions_table(const std::vector<ResolutionRow>& rows) {
  Table table{{"motion", "vertices_an_axis", "r_mm", "r_of_workspace", "r_over_longest_travel",
               "spacing_over_r", "rms_error_percent", "unknown_percent", "fill_us", "memory_MB"},
              {}};
  for (const ResolutionRow& row : rows) {
    table.rows.push_back({row.motion, count(static_cast<std::size_t>(row.vertices)),
                          1e3 * row.radius_m, row.radius_of_workspace, row.radius_over_travel,
                          row.spacing_over_radius, row.rms_error_percent, row.unknown_percent,
                          row.fill_us, row.memory_MB});
  }
  return table;
}

Table discrimination_table(const Discrimination& all) {
  Table table{{"method", "knowledge", "weber_fraction", "contrast", "right", "trials",
               "right_percent", "low_percent", "high_percent"},
              {}};
  for (const std::string& object : all.objects) {
    for (const std::string& named : all.objects) {
      table.columns.push_back(object.substr(object.find('_') + 1) + "_named_" +
                              named.substr(named.find('_') + 1));
    }
  }
  for (const DiscriminationRow& row : all.rows) {
    std::vector<Cell> cells{row.method,
                            std::string(to_string(row.knowledge)),
                            row.weber_fraction,
                            row.contrast,
                            count(row.answers.right),
                            count(row.answers.trials),
                            row.answers.percent(),
                            row.answers.low_percent(),
                            row.answers.high_percent()};
    for (const auto& object : row.confusion) {
      for (const std::size_t times : object) {
        cells.emplace_back(count(times));
      }
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

Table shapes_table(const std::vector<ShapeDifference>& shapes) {
  Table table{{"first", "second", "rms_mm", "largest_mm", "of_motion_percent", "d_prime"}, {}};
  for (const ShapeDifference& each : shapes) {
    table.rows.push_back({each.first, each.second, each.rms_mm, each.largest_mm,
                          each.of_motion_percent, each.d_prime});
  }
  return table;
}

}  // namespace forcegrid::paper
