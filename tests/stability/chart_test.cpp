// SPDX-License-Identifier: Apache-2.0
#include "stability/chart.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "stability/chart_numbers.h"
#include "stability/chart_report.h"
#include "stability/chart_rows.h"
#include "tests/stability/linear_table.h"

namespace forcegrid::stability {
namespace {

StabilityRow row_of(const std::string& part, const std::string& method, const std::string& hand,
                    double limit_N_per_m) {
  StabilityRow row;
  row.cell.part = part;
  row.cell.method = method;
  row.cell.hand = hand;
  row.cell.timing = "ideal";
  row.limit.largest_stable_N_per_m = limit_N_per_m;
  return row;
}

const StabilityNumber* number_named(const std::vector<StabilityNumber>& numbers,
                                    const std::string& beginning) {
  for (const StabilityNumber& number : numbers) {
    if (number.name.rfind(beginning, 0) == 0) {
      return &number;
    }
  }
  return nullptr;
}

TEST(StabilityCases, AreAllDifferentAndTheExactForceComesOncePerLoop) {
  for (const bool quick : {false, true}) {
    const auto cells = chart_cases({quick, {}, "kriging-bank", {}, {}});
    std::set<std::string> texts;
    for (const StabilityCase& cell : cells) {
      EXPECT_TRUE(texts.insert(cell.text()).second) << cell.text();
      if (cell.method == kExact) {
        EXPECT_EQ(cell.delay_s, 0.0);
        EXPECT_EQ(cell.loss, 0.0);
      }
    }
    EXPECT_EQ(cells.front().method, kExact);
  }
}

TEST(StabilityCases, TheWholeChartHasEveryNetworkOfTheUsualRates) {
  std::set<std::string> networks;
  for (const StabilityCase& cell : chart_cases({false, {"hold"}, "kriging", {part::kMap}, {}})) {
    if (cell.method == "hold" && cell.servo_rate_Hz <= 1000.0) {
      networks.insert(std::to_string(cell.simulator_rate_Hz) + '/' + std::to_string(cell.delay_s) +
                      '/' + std::to_string(cell.loss));
    }
  }
  EXPECT_EQ(networks.size(), 3U * 3U * 2U);
}

TEST(StabilityRows, SurviveJson) {
  StabilityRow row = row_of(part::kScene, "rls", "light", 123.0);
  row.limit.smallest_unstable_N_per_m = std::nan("");
  row.limit.failure = Behaviour::kCreep;
  row.run.behaviour = Behaviour::kDivergence;
  row.run.hold_peak_to_peak_m = std::nan("");
  row.run.samples_taken = 17;
  const StabilityRow back = row_from_json(to_json(row));
  EXPECT_EQ(back.cell.text(), row.cell.text());
  EXPECT_EQ(back.limit.failure, Behaviour::kCreep);
  EXPECT_EQ(back.run.behaviour, Behaviour::kDivergence);
  EXPECT_TRUE(std::isnan(back.run.hold_peak_to_peak_m));
  EXPECT_EQ(back.run.samples_taken, 17U);
  nlohmann::ordered_json damaged = to_json(row);
  damaged["behaviour"] = "sulking";
  EXPECT_THROW(row_from_json(damaged), nlohmann::ordered_json::exception);
}

TEST(StabilityNumbers, HoldTheWorstRowAgainstTheGoal) {
  StabilityChart chart;
  chart.rows = {
      row_of(part::kMap, kExact, "light", 1000.0), row_of(part::kMap, kExact, "firm", 2000.0),
      row_of(part::kMap, "rls", "light", 990.0), row_of(part::kMap, "rls", "firm", 1000.0)};
  chart.rows[2].run.force_error_percent = 0.2;
  chart.rows[3].run.force_error_percent = 0.1;
  const auto numbers = numbers_of(chart, "rls");
  const StabilityNumber* ratio = number_named(numbers, "largest stable stiffness");
  const StabilityNumber* error = number_named(numbers, "closed-loop force error");
  ASSERT_TRUE(ratio != nullptr && error != nullptr);
  EXPECT_DOUBLE_EQ(ratio->measured, 0.5);
  EXPECT_FALSE(ratio->met());
  EXPECT_NE(ratio->worst.find("firm"), std::string::npos);
  EXPECT_DOUBLE_EQ(error->measured, 0.2);
  EXPECT_TRUE(error->met());
  EXPECT_FALSE(number_named(numbers, "second contact")->known());
}

TEST(StabilityNumbers, AnUnstableRunIsNoSmallError) {
  StabilityChart chart;
  chart.rows = {row_of(part::kMap, "rls", "light", 0.0)};
  chart.rows[0].run.behaviour = Behaviour::kLimitCycle;
  chart.rows[0].run.force_error_percent = 0.01;
  const auto numbers = numbers_of(chart, "rls");
  EXPECT_FALSE(number_named(numbers, "closed-loop force error")->met());
}

TEST(SceneVerdicts, TheBestIsTheMostAccurateOfTheStable) {
  StabilityChart chart;
  for (const auto& [method, error_percent, behaviour] :
       {std::tuple{kExact, 0.0, Behaviour::kStable}, std::tuple{"rls", 2.0, Behaviour::kStable},
        std::tuple{"kriging", 3.0, Behaviour::kStable},
        std::tuple{"hold", 1.0, Behaviour::kLimitCycle}}) {
    StabilityRow row = row_of(part::kScene, method, "light", 1000.0);
    row.cell.scene = "cut";
    row.run.force_error_percent = error_percent;
    row.run.behaviour = behaviour;
    chart.rows.push_back(row);
  }
  const auto verdicts = scene_verdicts(chart);
  ASSERT_EQ(verdicts.size(), 1U);
  EXPECT_EQ(verdicts[0].scene, "cut");
  EXPECT_EQ(verdicts[0].best, "rls");
}

TEST(RunCase, FindsTheLimitOfTheExactForceOnATable) {
  StabilityCase cell;
  cell.part = part::kMap;
  cell.method = kExact;
  cell.hand = "light";
  cell.timing = "ideal";
  const StabilityRow row = run_case(cell, linear_table(50.0), 1);
  // A linear table in a light hand: the eigenvalues' limit, which quantisation hardly moves.
  cell.device = device::kLinear;
  EXPECT_NEAR(row.limit.largest_stable_N_per_m, eigenvalue_limit_of(cell),
              0.1 * eigenvalue_limit_of(cell));
  EXPECT_EQ(row.run.behaviour, Behaviour::kStable);
}

}  // namespace
}  // namespace forcegrid::stability
