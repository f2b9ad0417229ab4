// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart_requests.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "evaluation/charts/page_text.h"

namespace forcegrid::evaluation {
namespace {

struct Figure {
  const char* words;
  double (*of)(const ChartRow& row);
};

const std::vector<Figure>& figures_of_motion(const std::string& trajectory) {
  static const std::vector<Figure> kOfVisits{
      {"67 ms of the very first contact",
       [](const ChartRow& row) { return row.visits.first_contact.first_67ms_percent; }},
      {"67 ms at an unknown place",
       [](const ChartRow& row) { return row.visits.unknown_places.first_67ms_percent; }},
      {"67 ms at a known place",
       [](const ChartRow& row) { return row.visits.returns.first_67ms_percent; }}};
  static const std::vector<Figure> kOfOthers{
      {"first second", [](const ChartRow& row) { return row.verdict.rms_error_percent_first_1s; }},
      {"after it", [](const ChartRow& row) { return row.verdict.rms_error_percent_after_1s; }}};
  return trajectory == kVisits ? kOfVisits : kOfOthers;
}

std::string condition_of(int rate_per_s) {
  return rate_per_s == 0 ? "ideal" : "requests" + std::to_string(rate_per_s);
}

}  // namespace

std::vector<RequestRow> requests_of(const Chart& chart, const std::string& scene) {
  std::set<std::string> asking;
  for (const ChartRow& row : chart.rows) {
    if (row.scene == scene && row.verdict.requests_answered > 0) {
      asking.insert(row.method);
    }
  }
  std::vector<RequestRow> table;
  for (const ChartRow& row : chart.rows) {
    const auto rate = std::ranges::find_if(
        kRequestRates_per_s, [&](int each) { return row.condition == condition_of(each); });
    if (row.scene != scene || !asking.contains(row.method) || rate == kRequestRates_per_s.end()) {
      continue;
    }
    const auto column = static_cast<std::size_t>(rate - kRequestRates_per_s.begin());
    for (const Figure& figure : figures_of_motion(row.trajectory)) {
      auto line = std::ranges::find_if(table, [&](const RequestRow& each) {
        return each.method == row.method && each.trajectory == row.trajectory &&
               each.figure == figure.words;
      });
      if (line == table.end()) {
        RequestRow fresh{row.method, row.trajectory, figure.words, {}, {}};
        fresh.error_percent.fill(std::numeric_limits<double>::quiet_NaN());
        line = table.insert(table.end(), fresh);
      }
      line->error_percent[column] = figure.of(row);
      line->answers[column] = row.verdict.requests_answered;
    }
  }
  return table;
}

std::string requests_html(const Chart& chart, const std::string& scene) {
  const std::vector<RequestRow> table = requests_of(chart, scene);
  if (table.empty()) {
    return "";
  }
  std::string html =
      "<p>Effect of the rate of requests to the simulator: RMS error in % of RMS F<sub>o</sub>, "
      "and the number of requests over the whole motion.</p><table class=sortable>"
      "<thead><tr><th>method<th>motion<th>";
  for (const int rate_per_s : kRequestRates_per_s) {
    html += "<th>" + std::to_string(rate_per_s) + "/s";
  }
  html += "</tr></thead><tbody>";
  for (const RequestRow& row : table) {
    html +=
        "<tr><td>" + escaped(row.method) + "<td>" + escaped(row.trajectory) + "<td>" + row.figure;
    for (std::size_t i = 0; i < kRequestRates_per_s.size(); ++i) {
      html +=
          "<td>" + readable(row.error_percent[i]) +
          (row.answers[i] > 0 ? " <small>/ " + std::to_string(row.answers[i]) + "</small>" : "");
    }
    html += "</tr>";
  }
  return html + "</tbody></table>";
}

}  // namespace forcegrid::evaluation
