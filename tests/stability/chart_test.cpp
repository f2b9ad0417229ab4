// SPDX-License-Identifier: Apache-2.0
#include "stability/chart.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "evaluation/charts/page_text.h"
#include "stability/chart_numbers.h"
#include "stability/chart_pictures.h"
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

TEST(StabilityCases, ComparesTheDevicesOwnProcessorWithTheHostCellByCell) {
  std::map<std::string, std::set<std::string>> timings;
  for (StabilityCase cell : chart_cases({false, {}, "kriging", {part::kOnBoard}, {}})) {
    EXPECT_EQ(cell.servo_rate_Hz, 500.0);
    const std::string timing = std::exchange(cell.timing, "");
    timings[cell.text()].insert(timing);
  }
  // 3 methods with and 1 without a simulator's delays, in 4 hands.
  EXPECT_EQ(timings.size(), (3U * 2U + 1U) * 4U);
  for (const auto& [cell, of_cell] : timings) {
    EXPECT_EQ(of_cell, (std::set<std::string>{"w2_full_speed", "on_board"})) << cell;
  }
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

// gnuplot drops the entries of a legend that has no room for them, and says nothing.
TEST(StabilityPictures, HaveEveryCurveInTheLegend) {
  StabilityChart chart;
  std::vector<std::string> methods = chart_methods();
  for (int variant = 1; variant <= 5; ++variant) {
    methods.push_back("kriging nug=1e-" + std::to_string(variant));
  }
  for (const std::string& method : methods) {
    for (const double delay_s : {0.0, 0.02, 0.1}) {
      StabilityRow row = row_of(part::kMap, method, "light", 200.0);
      row.cell.timing = "w2_full_speed";
      row.cell.delay_s = method == kExact ? 0.0 : delay_s;
      row.cell.simulator_rate_Hz = method == kExact ? 0.0 : 30.0;
      chart.rows.push_back(row);
    }
  }
  for (const char* const kind : {device::kLinear, device::kStudy, device::kFriction}) {
    StabilityRow row = row_of(part::kPlane, kExact, "light", 300.0);
    row.cell.device = kind;
    row.cell.virtual_damping_N_s_per_m = 1.0;
    chart.rows.push_back(row);
  }
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) /
                                       ("stability_pictures_" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  const std::vector<std::filesystem::path> files = draw_pictures(chart, "auto", folder);
  ASSERT_EQ(files.size(), 2U);
  EXPECT_TRUE(draw_stiffness(chart, "auto", folder / "stiffness.svg"));
  // A curve's <title> is in the file in any case; its entry of the legend is a <text>.
  const auto has_entry = [](const std::string& svg, const std::string& title) {
    return svg.find("<text>" + title + "</text>") != std::string::npos;
  };
  for (const char* const name : {"delay_light_500Hz.svg", "stiffness.svg"}) {
    const std::string svg = evaluation::read_text(folder / name);
    for (const std::string& method : methods) {
      EXPECT_TRUE(has_entry(svg, method)) << name << ": " << method;
    }
    EXPECT_TRUE(has_entry(svg, "b > K T / 2 (Colgate, Schenkel)")) << name;
    EXPECT_TRUE(has_entry(svg, "K &lt; b / age (hold)")) << name;
  }
  const std::string plane = evaluation::read_text(folder / "plane_light.svg");
  for (const char* const title :
       {"exact, linear device", "exact, study device", "exact, friction device",
        "eigenvalues of the linear plant", "b > K T / 2 + |B| (Colgate, Schenkel)",
        "min(2 b / T, 2 f_c / step), f_c = 0.1 N (Abbott, Okamura)"}) {
    EXPECT_TRUE(has_entry(plane, title)) << title;
  }
  std::filesystem::remove_all(folder);
}

TEST(StabilityPage, BeginsWithUpToWhichStiffness) {
  const StabilityChart chart;
  const std::string page = stability_html(
      chart, {}, {{"Up to which stiffness?", "words", "<svg id='a'/>"}}, {"<svg id='b'/>"});
  EXPECT_LT(page.find("Up to which stiffness?"), page.find("<svg id='a'/>"));
  EXPECT_LT(page.find("<svg id='a'/>"), page.find("<h2>Goals"));
  EXPECT_GT(page.find("<svg id='b'/>"), page.find("<h2>Pictures"));
}

TEST(StabilityCases, OfThePictureHaveTheExactForceOnceAndEachMethodAtEveryDelay) {
  const auto cells = stiffness_cells({"hold", kExact, "auto"});
  ASSERT_EQ(cells.size(), 9U);
  EXPECT_EQ(cells.front().method, kExact);
  EXPECT_EQ(cells.back().method, "auto");
  EXPECT_EQ(cells.back().delay_s, 0.15);
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

TEST(RunCase, ACellThatCanNotBeJudgedIsNamedWithItsReasonOnPageAndInJson) {
  StabilityCase cell;
  cell.part = part::kScene;
  cell.scene = "no <scene>";
  cell.method = "hold";
  cell.hand = "light";
  cell.timing = "ideal";
  StabilityChart chart;
  EXPECT_FALSE(try_case(cell, linear_table(50.0), 1, chart.not_judged));
  ASSERT_EQ(chart.not_judged.size(), 1U);
  EXPECT_NE(chart.not_judged[0].reason.find("'no <scene>' is not known"), std::string::npos);

  const std::string page = stability_html(chart, {}, {}, {});
  EXPECT_NE(page.find("not judged: scene 'no &lt;scene&gt;"), std::string::npos) << page;
  const auto json = nlohmann::json::parse(stability_json(chart, {}));
  ASSERT_EQ(json.at("not_judged").size(), 1U);
  EXPECT_EQ(json.at("not_judged")[0].at("cell"), cell.text());
  EXPECT_EQ(json.at("not_judged")[0].at("reason"), chart.not_judged[0].reason);
}

}  // namespace
}  // namespace forcegrid::stability
