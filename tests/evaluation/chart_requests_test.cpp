// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart_requests.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "evaluation/charts/chart_report.h"

namespace forcegrid::evaluation {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

ChartRow row_of(const std::string& method, const std::string& trajectory,
                const std::string& condition, double after_percent, std::size_t answers) {
  ChartRow row;
  row.scene = "block";
  row.method = method;
  row.trajectory = trajectory;
  row.condition = condition;
  row.verdict.rms_error_percent_first_1s = 2.0 * after_percent;
  row.verdict.rms_error_percent_after_1s = after_percent;
  row.verdict.requests_answered = answers;
  row.visits.unknown_places.first_67ms_percent = 3.0 * after_percent;
  return row;
}

Chart some_chart() {
  Chart chart;
  chart.tables.push_back({});
  chart.tables[0].scene = "block";
  chart.rows = {
      row_of("auto", "poke", "ideal", 0.4, 0),       row_of("auto", "poke", "requests30", 0.3, 4),
      row_of("auto", "poke", "requests120", 0.1, 9), row_of("auto", "poke", "delay100", 7.0, 0),
      row_of("hold", "poke", "ideal", 30.0, 0),      row_of("hold", "poke", "requests30", 30.0, 0),
      row_of("auto", "visits", "requests60", 0.2, 5)};
  return chart;
}

TEST(ChartRequests, PutsTheErrorsOfAMethodThatAsksSideByRateAndLeavesOthersOut) {
  const auto table = requests_of(some_chart(), "block");
  ASSERT_EQ(table.size(), 5U);  // two figures of poke, three of visits
  for (const RequestRow& row : table) {
    EXPECT_EQ(row.method, "auto");
  }
  EXPECT_EQ(table[1].figure, "after it");
  EXPECT_EQ(table[1].error_percent[0], 0.4);
  EXPECT_EQ(table[1].error_percent[1], 0.3);
  EXPECT_TRUE(std::isnan(table[1].error_percent[2]));
  EXPECT_EQ(table[1].error_percent[3], 0.1);
  EXPECT_EQ(table[1].answers[3], 9U);
  EXPECT_EQ(table[0].error_percent[0], 0.8);  // first second
  EXPECT_EQ(table[3].figure, "67 ms at an unknown place");
  EXPECT_DOUBLE_EQ(table[3].error_percent[2], 0.6);
  EXPECT_TRUE(requests_of(some_chart(), "another scene").empty());
}

TEST(ChartRequests, AreOnThePageAndInItsNumbers) {
  const std::string page = chart_html(some_chart(), ChartOptions{}, {}, {}, {});
  EXPECT_THAT(page, HasSubstr("<td>auto<td>poke<td>after it<td>0.400<td>0.300 <small>/ 4</small>"));
  EXPECT_THAT(page, HasSubstr("<th>120/s"));
  EXPECT_THAT(chart_json(some_chart(), ChartOptions{}), HasSubstr("\"by_requests\""));
  Chart without = some_chart();
  without.rows.resize(1);
  EXPECT_THAT(chart_html(without, ChartOptions{}, {}, {}, {}), Not(HasSubstr("<th>120/s")));
}

}  // namespace
}  // namespace forcegrid::evaluation
