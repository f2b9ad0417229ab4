// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>

#include "evaluation/charts/chart_plot.h"
#include "evaluation/charts/chart_report.h"
#include "evaluation/charts/chart_rows.h"
#include "evaluation/charts/chart_summary.h"
#include "evaluation/files/gnuplot.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/scenarios.h"
#include "tests/paper/tiny_scenes.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::string fresh_folder(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / name;
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  return folder.string();
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

// A servo that follows `circle`.
std::vector<ServoInstant> circling() {
  const Trajectory circle("circle");
  std::vector<ServoInstant> servo;
  for (int i = 0; i < 10000; ++i) {
    ServoInstant instant;
    instant.time_s = i / kChartServoRate_Hz;
    instant.position_W = circle.position_W(instant.time_s);
    servo.push_back(instant);
  }
  return servo;
}

std::vector<double> works_of(const std::function<Vector3d(const Vector3d&)>& field) {
  const std::vector<ServoInstant> servo = circling();
  std::vector<Vector3d> forces_W;
  for (const ServoInstant& instant : servo) {
    forces_W.push_back(field(instant.position_W - first_contact_point_W()));
  }
  return closed_loop_work_J(servo, forces_W, Trajectory::kFirstLoop_s, Trajectory::kLoopPeriod_s);
}

ChartRow row_of(const std::string& trajectory, const std::string& condition,
                const std::string& method, double after_percent) {
  ChartRow row;
  row.scene = "block";
  row.trajectory = trajectory;
  row.condition = condition;
  row.method = method;
  row.key = trajectory + condition + method;
  row.verdict.rms_error_percent_after_1s = after_percent;
  row.verdict.rms_error_percent_first_1s = 10.0 * after_percent;
  row.verdict.max_error_percent_after_1s = 5.0 * after_percent;
  row.verdict.cycle_ns = 100.0;
  return row;
}

const ChartNumber& number_named(const std::vector<ChartNumber>& numbers, const std::string& name) {
  for (const ChartNumber& each : numbers) {
    if (each.name == name) {
      return each;
    }
  }
  throw std::runtime_error("no number " + name);
}

TEST(ClosedLoopWork, OfAConservativeFieldIsZero) {
  // The gradient of -50 x^2 - 60 y^2 - 3000 y z^2 + 0.2 x: the stored energy is millijoules.
  const std::vector<double> works_J = works_of([](const Vector3d& d) {
    return Vector3d(-100.0 * d.x() + 0.2, -120.0 * d.y() - 3000.0 * d.z() * d.z(),
                    -6000.0 * d.y() * d.z());
  });
  ASSERT_EQ(works_J.size(), 14U);
  for (const double work_J : works_J) {
    EXPECT_NEAR(work_J, 0.0, 1e-12);
  }
}

TEST(ClosedLoopWork, OfACurlIsTwiceTheCurlTimesTheEnclosedArea) {
  // F = w (-y, x, 0): the work around a loop is 2 w times the area of its projection on x, y,
  // which is the circle's times cos 45 degrees.
  constexpr double kCurl_N_per_m = 3.0;
  const std::vector<double> works_J = works_of([](const Vector3d& d) {
    return Vector3d(-kCurl_N_per_m * d.y(), kCurl_N_per_m * d.x(), 0.0);
  });
  const double area_m2 = std::numbers::pi * std::pow(Trajectory::kLoopRadius_m, 2);
  const double expected_J = 2.0 * kCurl_N_per_m * area_m2 / std::numbers::sqrt2;
  ASSERT_EQ(works_J.size(), 14U);
  for (const double work_J : works_J) {
    EXPECT_NEAR(work_J, expected_J, 1e-4 * expected_J);  // a chord for an arc of 1/625 turn
  }
}

TEST(ParetoFront, HoldsWhatNoOtherBeats) {
  EXPECT_THAT(pareto_front({1, 2, 3, 4, 2, kNan}, {9, 5, 6, 1, 7, 0.5}),
              ElementsAre(true, true, false, true, false, false));
  EXPECT_THAT(pareto_front({1, 1, 2}, {3, 3, 3}), ElementsAre(true, true, false));
  EXPECT_TRUE(pareto_front({}, {}).empty());
}

TEST(ChartPoints, AreGeometricMeansOverTheStaticTrajectories) {
  Chart chart;
  chart.rows = {row_of("chirp", "ideal", "hold", 1.0), row_of("poke", "ideal", "hold", 16.0),
                row_of("regrab", "ideal", "hold", 100.0),
                row_of("chirp", "delay100", "hold", 100.0),
                row_of("chirp", "stiffness", "tangent", 2.0)};
  const std::vector<ChartPoint> points = points_of(chart, "block");
  ASSERT_EQ(points.size(), 2U);
  for (const ChartPoint& point : points) {
    const bool hold = point.method == "hold";
    EXPECT_EQ(point.condition, hold ? "ideal" : "stiffness");
    EXPECT_NEAR(point.error_percent, hold ? 4.0 : 2.0, 1e-12);
    EXPECT_EQ(point.on_front, !hold);
  }
  EXPECT_TRUE(points_of(chart, "small").empty());
}

TEST(ChartNumbers, HoldTheWorstWindowAfterAReturnAgainstItsGoal) {
  Chart chart;
  chart.rows = {row_of("exploration", "ideal", "kriging-store", 0.3)};
  ReturnErrors& returns = chart.rows.front().returns;
  returns.first_33ms_percent = 0.05;
  returns.to_100ms_percent = 0.08;
  returns.to_500ms_percent = 0.12;
  returns.to_1s_percent = 0.03;
  const std::vector<ChartNumber> numbers = numbers_of(chart, "kriging");
  const ChartNumber& each = number_named(numbers, "return after two minutes, kriging-store");
  EXPECT_DOUBLE_EQ(each.measured, 0.12);
  EXPECT_EQ(each.worst, "0.1 to 0.5 s");
  EXPECT_FALSE(each.met());
  EXPECT_FALSE(number_named(numbers, "return after two minutes, forcegrid-kriging").known());
}

TEST(ChartNumbers, HoldTheWorstTrajectoryAgainstTheGoal) {
  Chart chart;
  chart.rows = {
      row_of("chirp", "ideal", "kriging", 0.1),     row_of("poke", "ideal", "kriging", 0.4),
      row_of("regrab", "ideal", "kriging", 0.2),    row_of("poke", "stiffness", "kriging", 0.3),
      row_of("chirp", "stiffness", "kriging", 0.1), row_of("chirp", "ideal", "hold", 90.0)};
  const std::vector<ChartNumber> numbers = numbers_of(chart, "kriging");
  const ChartNumber& each = number_named(numbers, "RMS error on each static trajectory");
  EXPECT_DOUBLE_EQ(each.measured, 0.4);
  EXPECT_EQ(each.worst, "poke");
  EXPECT_EQ(each.scene, "block");
  EXPECT_FALSE(each.met());
  EXPECT_NEAR(number_named(numbers, "its geometric mean over them").measured, 0.2, 1e-12);
  EXPECT_DOUBLE_EQ(number_named(numbers, "worst instant after 1 s").measured, 2.0);
  EXPECT_TRUE(number_named(numbers, "worst instant after 1 s").met());
  EXPECT_DOUBLE_EQ(number_named(numbers, "first second of poke, with stiffness").measured, 3.0);
  EXPECT_DOUBLE_EQ(number_named(numbers, "error with stiffness / without").measured, 1.0);
  EXPECT_DOUBLE_EQ(number_named(numbers, "re-grab elsewhere, same stiffness").measured, 0.2);
  const ChartNumber& unknown = number_named(numbers, "+100 ms delay");
  EXPECT_FALSE(unknown.known());
  EXPECT_FALSE(unknown.met());
}

TEST(RowStore, KeepsRowsForTheSameProgramOnly) {
  const std::string folder = fresh_folder("row_store");
  ChartRow row = row_of("chirp", "ideal", "forcegrid cells=9,9,9", 12.5);
  row.verdict.adaptation_s = kNan;
  row.verdict.memory_bytes = 123456;
  {
    RowStore store(folder, "program one");
    EXPECT_EQ(store.find(row.key), nullptr);
    store.keep(row);
  }
  {
    RowStore store(folder, "program one");
    const ChartRow* kept = store.find(row.key);
    ASSERT_NE(kept, nullptr);
    EXPECT_EQ(kept->method, row.method);
    EXPECT_EQ(kept->verdict.rms_error_percent_after_1s, 12.5);
    EXPECT_EQ(kept->verdict.memory_bytes, 123456U);
    EXPECT_TRUE(std::isnan(kept->verdict.adaptation_s));
    EXPECT_TRUE(std::isnan(kept->loop_work_percent));
  }
  EXPECT_EQ(RowStore(folder, "program two").find(row.key), nullptr);
}

TEST(RowStore, JudgesAgainWhatWasCutOff) {
  const std::string folder = fresh_folder("row_store_cut");
  const ChartRow first = row_of("chirp", "ideal", "hold", 1.0);
  const ChartRow second = row_of("poke", "ideal", "hold", 2.0);
  {
    RowStore store(folder, "p");
    store.keep(first);
    store.keep(second);
  }
  const std::filesystem::path file = std::filesystem::path(folder) / "rows.jsonl";
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - 30);
  RowStore store(folder, "p");
  EXPECT_NE(store.find(first.key), nullptr);
  EXPECT_EQ(store.find(second.key), nullptr);
  store.keep(second);
  EXPECT_NE(store.find(second.key), nullptr);
}

TEST(RowStore, OneChartAFolder) {
  const std::string folder = fresh_folder("row_store_lock");
  const RowStore first(folder, "p");
  try {
    const RowStore second(folder, "p");
    FAIL() << "no error";
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("another chart is writing to " + folder));
  }
}

TEST(ChartReport, HasARowALineAndLeavesUnknownFiguresEmpty) {
  Chart chart;
  chart.rows = {row_of("chirp", "ideal", "forcegrid cells=9,9,9", 12.5)};
  const std::string csv = chart_csv(chart);
  EXPECT_THAT(csv, HasSubstr("scene,trajectory,condition,method,rms_error_percent_first_1s,"));
  EXPECT_THAT(csv, HasSubstr("\nblock,chirp,ideal,\"forcegrid cells=9,9,9\",125,0,0,12.5,"));
  EXPECT_THAT(csv, Not(HasSubstr("nan")));
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 2);
}

TEST(ChartReport, WritesAPageThatNeedsNothingElse) {
  ChartOptions options;
  options.out = fresh_folder("chart_page");
  options.default_method = "kriging";
  Chart chart;
  chart.tables.push_back({});
  chart.tables[0].scene = "block";
  chart.tables[0].title = "a <large> block";
  chart.rows = {row_of("chirp", "ideal", "kriging", 0.1),
                row_of("chirp", "ideal", "forcegrid", 9.0), row_of("chirp", "ideal", "hold", 30.0)};
  chart.rows[1].verdict.cycle_ns = 3000.0;
  chart.rows[2].verdict.cycle_ns = 5.0;
  chart.numbers = numbers_of(chart, "kriging");
  chart.not_run.push_back({"x", "a reason"});
  const auto files = write_chart(chart, options, {{"A figure", "<?xml?><svg id='figure'></svg>"}});
  EXPECT_EQ(files.size(), 5U);
  const std::string page = text_of(options.out / "index.html");
  EXPECT_THAT(page, HasSubstr("a &lt;large&gt; block"));
  EXPECT_THAT(page, HasSubstr("<svg id='figure'>"));
  EXPECT_THAT(page, HasSubstr("a reason"));
  EXPECT_THAT(page, HasSubstr("class=met>met, 67 % to spare"));  // 0.1 of 0.3
  // The first screen comes before the goals, and has the picture of error and cost.
  EXPECT_LT(page.find("How accurate, at what cost?"), page.find("<svg"));
  EXPECT_LT(page.find("<svg"), page.find("<h2>Goals"));
  EXPECT_THAT(page, HasSubstr("<summary>Goals that are not in this selection: "));
  EXPECT_THAT(page, Not(HasSubstr("src=\"")));
  EXPECT_THAT(page, Not(HasSubstr("<link")));
  const std::string svg = text_of(options.out / "error_against_cost_block.svg");
  EXPECT_THAT(svg, HasSubstr("kriging"));
  EXPECT_THAT(svg, HasSubstr("forcegrid (the paper's)"));
  EXPECT_THAT(svg, HasSubstr("Pareto front"));
  const auto json = nlohmann::json::parse(text_of(options.out / "accuracy.json"));
  EXPECT_EQ(json.at("rows").size(), 3U);
  EXPECT_EQ(json.at("numbers").at(0).at("goal"), 0.3);
  EXPECT_EQ(json.at("numbers").at(0).at("met"), true);
  EXPECT_TRUE(json.at("numbers").at(7).at("measured").is_null());
  EXPECT_EQ(json.at("points").size(), 3U);
}

TEST(FileNamePart, KeepsANameAndTellsPathsApart) {
  EXPECT_EQ(file_name_part("small+wall_flat"), "small+wall_flat");
  EXPECT_EQ(file_name_part("mine.toml"), "mine.toml");
  const std::string one = file_name_part("/one/mine.toml+cut");
  EXPECT_THAT(one, ::testing::MatchesRegex("mine.toml.cut-[0-9a-f]{8}"));
  EXPECT_EQ(file_name_part("/one/mine.toml+cut"), one);
  EXPECT_NE(file_name_part("/two/mine.toml+cut"), one);
}

TEST(GoalVerdict, SaysByHowMuch) {
  EXPECT_EQ(goal_verdict(0.2, 0.4, false).words, "met, 50 % to spare");
  EXPECT_EQ(goal_verdict(0.4, 0.4, false).words, "met");
  EXPECT_EQ(goal_verdict(4.28, 4.0, false).words, "missed by 7 %");
  EXPECT_STREQ(goal_verdict(4.28, 4.0, false).css_class, "near");
  EXPECT_EQ(goal_verdict(0.45, 0.3, false).words, "missed by 50 %");
  EXPECT_STREQ(goal_verdict(0.45, 0.3, false).css_class, "missed");
  EXPECT_EQ(goal_verdict(1.02, 0.3, false).words, "missed, 3.4 times the goal");
  EXPECT_EQ(goal_verdict(0.76, 0.95, true).words, "missed by 20 %");
  EXPECT_TRUE(goal_verdict(0.96, 0.95, true).met);
  EXPECT_EQ(goal_verdict(std::numeric_limits<double>::infinity(), 1.0, false).words,
            "missed: not measurable");
  // Agrees with the numbers of the charts.
  for (const double measured : {0.1, 0.3, 0.31}) {
    const ChartNumber number{"n", "s", 0.3, measured, "%", ""};
    EXPECT_EQ(number.met(), goal_verdict(measured, 0.3, false).met) << measured;
    EXPECT_EQ(number.met(), number.ratio() <= 1.0) << measured;
  }
}

// The table of this object ends 15 mm above the contact point, and chirp goes up by 20 mm.
TEST(MakeChart, GoesOnAfterARowThatCanNotBeJudged) {
  ChartOptions options;
  options.out = fresh_folder("chart_goes_on");
  options.default_method = "hold";
  options.scenes = {paper::tiny_scene("shallow", 20.0, 0.3)};
  options.lattice.nodes = {15, 15, 8};
  options.trajectories = {"chirp", "circle"};
  options.conditions = {"ideal", "requests120"};
  options.methods = {"hold", "rls", "forcegrid+request"};
  options.seed = 1;
  std::vector<std::string> said;
  options.say = [&said](const std::string& text) { said.push_back(text); };
  const Chart chart = make_chart(options);
  // hold and rls under both conditions, forcegrid+request under requests120.
  ASSERT_EQ(chart.not_judged.size(), 5U);
  ASSERT_EQ(chart.rows.size(), 5U);
  for (const NotJudged& each : chart.not_judged) {
    EXPECT_EQ(each.trajectory, "chirp");
    EXPECT_THAT(each.reason, HasSubstr("lies outside its range"));
  }
  for (const ChartRow& row : chart.rows) {
    EXPECT_EQ(row.trajectory, "circle");
    EXPECT_TRUE(std::isfinite(row.verdict.rms_error_percent_after_1s)) << row.method;
  }
  EXPECT_THAT(said, ::testing::Contains(HasSubstr("not judged: rls on ")));
  // The rest is kept, and what was not judged is tried again.
  EXPECT_EQ(make_chart(options).rows_kept, 5U);

  options.trajectories = {"chirp"};
  try {
    make_chart(options);
    ADD_FAILURE() << "a chart of nothing";
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("none of the 5 rows could be judged; the first: "));
  }
}

// A row that could not be judged is seen with its reason, and counts nowhere.
TEST(ChartReport, MarksWhatWasNotJudged) {
  ChartOptions options;
  options.out = fresh_folder("chart_not_judged");
  options.default_method = "kriging";
  Chart chart;
  chart.tables.push_back({});
  chart.tables[0].scene = "block";
  chart.rows = {row_of("chirp", "ideal", "kriging", 0.1), row_of("chirp", "ideal", "hold", 30.0),
                row_of("poke", "ideal", "hold", 40.0)};
  chart.not_judged = {{"block", "poke", "ideal", "kriging", "it left the \"table\" <far>"}};
  chart.numbers = numbers_of(chart, "kriging");
  EXPECT_DOUBLE_EQ(number_named(chart.numbers, "its geometric mean over them").measured, 0.1);
  write_chart(chart, options, {});
  const std::string csv = text_of(options.out / "accuracy.csv");
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 5);
  EXPECT_THAT(csv, HasSubstr("\nblock,poke,ideal,\"kriging\",,"));
  EXPECT_THAT(csv, HasSubstr(",\"it left the \"\"table\"\" <far>\"\n"));
  const std::string page = text_of(options.out / "index.html");
  EXPECT_THAT(page, HasSubstr("not judged: it left the &quot;table&quot; &lt;far&gt;"));
  EXPECT_THAT(page, HasSubstr("&quot;table&quot; &lt;far&gt;\">not judged")) << "the scene's cell";
  const auto json = nlohmann::json::parse(text_of(options.out / "accuracy.json"));
  EXPECT_EQ(json.at("rows").size(), 3U);
  EXPECT_EQ(json.at("not_judged").at(0).at("method"), "kriging");
  const std::string head = csv.substr(0, csv.find('\n'));
  std::string line = csv.substr(csv.find("block,poke,ideal,\"kriging\""));
  line = line.substr(0, line.find('\n'));
  EXPECT_EQ(std::count(line.begin(), line.end(), ','), std::count(head.begin(), head.end(), ','));
}

// The text of a label in the SVG, at x and y in gnuplot's units of pixels.
TEST(ChartPlot, ShowsTheLabelsOfTheFrontAndOfTheMethodsAskedFor) {
  const std::filesystem::path file = std::filesystem::path(fresh_folder("plot")) / "some.svg";
  const std::vector<ChartPoint> points{{"hold", "ideal", 30.0, 5.0, true},
                                       {"worse", "ideal", 40.0, 50.0, false},
                                       {"asked", "ideal", 35.0, 60.0, false},
                                       {"best", "stiffness", 0.1, 900.0, true}};
  ASSERT_TRUE(write_error_cost_svg(file, "t", points,
                                   {.width_px = 640.0, .height_px = 520.0, .labelled = {"asked"}}));
  std::string svg = text_of(file);
  EXPECT_THAT(svg, HasSubstr("viewBox=\"0 0 640 520\""));
  for (const char* const label : {"hold", "asked", "best [stiffness]"}) {
    EXPECT_THAT(svg, HasSubstr(std::string(">") + label + "<")) << label;
  }
  EXPECT_THAT(svg, Not(HasSubstr(">worse<")));
  ASSERT_TRUE(write_error_cost_svg(file, "t", points));
  svg = text_of(file);
  EXPECT_THAT(svg, HasSubstr(">worse<"));
}

TEST(ChartPlot, LeavesOutWhatALogarithmCantShow) {
  const std::filesystem::path file = std::filesystem::path(fresh_folder("plot")) / "none.svg";
  EXPECT_FALSE(
      write_error_cost_svg(file, "t", {{"a", "ideal", 0.0, 5.0}, {"b", "ideal", kNan, 5.0}}));
  EXPECT_FALSE(std::filesystem::exists(file));
}

TEST(Gnuplot, APictureThatIsCutOffIsNoPicture) {
  const std::string folder = fresh_folder("gnuplot_full_disk");
  for (const std::string name : {"picture.svg", "picture.png"}) {
    const std::string file = folder + "/" + name;
    const std::string script = std::string("set terminal ") +
                               (name.ends_with("svg") ? "svg" : "pngcairo") + "\nset output '" +
                               file + "'\nplot x\n";
    EXPECT_NO_THROW(run_gnuplot(script, file));
    EXPECT_TRUE(std::filesystem::exists(file));
    std::filesystem::remove(file);
    std::filesystem::create_symlink("/dev/full", file);  // which no byte can be written to
    try {
      run_gnuplot(script, file);
      ADD_FAILURE() << name << " is taken for drawn";
    } catch (const ChartError& error) {
      EXPECT_THAT(error.what(), HasSubstr(name + " (the file is incomplete); "));
      EXPECT_THAT(error.what(), HasSubstr("free some space"));
    }
    EXPECT_TRUE(std::filesystem::exists("/dev/full"));
  }
}

}  // namespace
}  // namespace forcegrid::evaluation
