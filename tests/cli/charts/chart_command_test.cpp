// SPDX-License-Identifier: Apache-2.0
// `forcegrid chart accuracy` as its user starts it, on the small scene.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/paper/tiny_scenes.h"
#include "tests/support/command_test.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using ::testing::IsSupersetOf;
using ::testing::MatchesRegex;
using testing::Program;
using testing::text_of;

constexpr std::chrono::seconds kPatience{200};

class ChartAccuracy : public testing::CommandTest {
 protected:
  ChartAccuracy() : CommandTest(kPatience) {}

  // The force table is made once for all tests of a run.
  static void SetUpTestSuite() { shared_cache = fresh_folder("chart_cache"); }

  std::vector<std::string> command(const std::string& out, const std::string& trajectories,
                                   const std::string& conditions, const std::string& methods) {
    return {"chart",     "accuracy", "--out",          out,          "--cache",      shared_cache,
            "--scenes",  "small",    "--trajectories", trajectories, "--conditions", conditions,
            "--methods", methods};
  }

  static json result(const std::string& folder) {
    return json::parse(text_of(folder + "/accuracy.json"), nullptr, false);
  }

  static const json* row_of(const json& chart, const std::string& trajectory,
                            const std::string& condition, const std::string& method) {
    for (const json& row : chart.at("rows")) {
      if (row.at("trajectory") == trajectory && row.at("condition") == condition &&
          row.at("method") == method) {
        return &row;
      }
    }
    return nullptr;
  }

  static std::string shared_cache;
};

std::string ChartAccuracy::shared_cache;

TEST_F(ChartAccuracy, JudgesWritesAndGoesOnWhereItWas) {
  const std::string folder = fresh_folder("chart");
  ASSERT_EQ(run(command(folder, "chirp,circle", "ideal,stiffness", "hold;forcegrid;tangent")), 0)
      << error_;
  EXPECT_THAT(error_, HasSubstr("small: force table"));
  EXPECT_THAT(error_, HasSubstr("% (RMS) at 200 positions of a motion"));
  const json chart = result(folder);
  ASSERT_TRUE(chart.is_object());
  // hold and forcegrid under both conditions, tangent where there is stiffness; two trajectories.
  ASSERT_EQ(chart.at("rows").size(), 10U);
  EXPECT_EQ(row_of(chart, "chirp", "ideal", "tangent"), nullptr);

  // The method study's figures for this motion on such blocks, within 20 %.
  const json* hold = row_of(chart, "chirp", "ideal", "hold");
  const json* grid = row_of(chart, "chirp", "ideal", "forcegrid");
  const json* tangent = row_of(chart, "chirp", "stiffness", "tangent");
  ASSERT_TRUE(hold != nullptr && grid != nullptr && tangent != nullptr);
  EXPECT_NEAR(hold->at("rms_error_percent_after_1s").get<double>(), 36.8, 7.4);
  EXPECT_NEAR(grid->at("rms_error_percent_after_1s").get<double>(), 10.8, 2.2);
  EXPECT_NEAR(tangent->at("rms_error_percent_after_1s").get<double>(), 5.8, 1.2);
  EXPECT_TRUE(hold->at("loop_work_percent").is_null());
  // Streaming lags by 50 ms: on an isotropic spring that feeds pi K r^2 sin(w T), 156 % of the
  // stored energy, into the hand at every turn; sideways this block is stiffer.
  const json* circling = row_of(chart, "circle", "ideal", "hold");
  ASSERT_NE(circling, nullptr);
  EXPECT_GT(circling->at("loop_work_percent").get<double>(), 156.0);
  EXPECT_LT(circling->at("loop_work_percent").get<double>(), 400.0);
  EXPECT_LT(chart.at("scenes").at(0).at("difference_along_motion").at("rms_percent"), 0.1);
  for (const char* const name :
       {"/accuracy.csv", "/index.html", "/error_against_cost_small.svg",
        "/figures/small-chirp-ideal/forces.svg", "/figures/small-chirp-ideal/forces.csv"}) {
    EXPECT_TRUE(std::filesystem::exists(folder + name)) << name;
  }

  // One method more: the ten rows stay as they are.
  const std::string before = text_of(folder + "/rows.jsonl");
  ASSERT_EQ(
      run(command(folder, "chirp,circle", "ideal,stiffness", "hold;forcegrid;tangent;linear")), 0)
      << error_;
  const json more = result(folder);
  EXPECT_EQ(more.at("rows").size(), 14U);
  EXPECT_EQ(more.at("rows_kept"), 10);
  EXPECT_EQ(text_of(folder + "/rows.jsonl").substr(0, before.size()), before);
  EXPECT_THAT(out_, HasSubstr("14 rows (10 of them from an earlier call)"));
}

// The lines of accuracy.csv without the columns of costs, which are never the same twice.
std::vector<std::string> rows_without_costs(const std::string& folder) {
  std::istringstream lines(text_of(folder + "/accuracy.csv"));
  const auto cells_of = [](const std::string& line) {
    std::vector<std::string> cells;
    std::istringstream stream(line);
    for (std::string cell; std::getline(stream, cell, ',');) {
      cells.push_back(cell);
    }
    return cells;
  };
  std::vector<std::string> rows;
  std::vector<std::string> names;
  for (std::string line; std::getline(lines, line);) {
    const std::vector<std::string> cells = cells_of(line);
    names = names.empty() ? cells : names;
    std::string row;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string name = i < names.size() ? names[i] : "";
      row += name.find("_ns") != std::string::npos || name.find("_us") != std::string::npos
                 ? ""
                 : cells[i] + ",";
    }
    rows.push_back(row);
  }
  return rows;
}

// As a batch engine starts them: two processes, a part each, then one that puts them together.
TEST_F(ChartAccuracy, ComesOutTheSameInPartsThatGnuParallelStarts) {
  const std::string whole = fresh_folder("chart_whole");
  const std::string parts = fresh_folder("chart_parts");
  const auto arguments = [&](const std::string& out) {
    return command(out, "chirp,circle,poke", "ideal,delay100", "hold;linear");
  };
  ASSERT_EQ(run(arguments(whole)), 0) << error_;
  std::vector<std::string> shards = {"parallel", "--will-cite", "-j2", "--halt", "now,fail=1"};
  for (const std::string& word : forcegrid::testing::forcegrid_command(arguments(parts + "/{}"))) {
    shards.push_back(word.find(';') != std::string::npos ? "'" + word + "'" : word);
  }
  shards.insert(shards.end(), {"--shard", "{}/2", ":::", "1", "2"});
  Program parallel(shards);
  ASSERT_EQ(parallel.wait(kPatience), 0) << parallel.standard_error();
  EXPECT_THAT(parallel.standard_output(), HasSubstr("Shard 1/2: 6 rows"));
  EXPECT_THAT(parallel.standard_output(), HasSubstr("Shard 2/2: 6 rows"));

  std::vector<std::string> merging = arguments(parts + "/all");
  merging.insert(merging.end(), {"--merge", parts + "/1", parts + "/2"});
  ASSERT_EQ(run(merging), 0) << error_;
  EXPECT_THAT(error_, HasSubstr("merged 12 rows of 2 shards"));
  EXPECT_THAT(out_, HasSubstr("12 rows (12 of them from an earlier call)"));
  const std::vector<std::string> expected = rows_without_costs(whole);
  EXPECT_EQ(expected.size(), 13U);
  EXPECT_EQ(rows_without_costs(parts + "/all"), expected);

  std::vector<std::string> wrong = arguments(whole);
  wrong.insert(wrong.end(), {"--shard", "3/2"});
  EXPECT_EQ(run(wrong), 2);
  EXPECT_THAT(error_, HasSubstr("2/8"));
}

TEST_F(ChartAccuracy, GoesOnAfterCtrlC) {
  const std::string folder = fresh_folder("chart_stopped");
  const std::vector<std::string> arguments =
      command(folder, "chirp,lissajous,random", "ideal,delay100,lossy,rate60",
              "forcegrid;forcegrid cells=80;forcegrid r=20mm;forcegrid unit=m");
  std::size_t lines = 0;
  {
    Program program = Program::forcegrid(arguments);
    const std::string rows = folder + "/rows.jsonl";
    for (int i = 0; i < 10000 && lines < 2; ++i) {
      const std::string text = text_of(rows);
      lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    program.send_signal(SIGINT);
    EXPECT_EQ(program.wait(kPatience), 130);
    EXPECT_THAT(program.standard_error(), HasSubstr("repeat the command to continue"));
  }
  ASSERT_GE(lines, 2U);
  ASSERT_EQ(run(arguments), 0) << error_;
  const json chart = result(folder);
  EXPECT_EQ(chart.at("rows").size(), 48U);
  EXPECT_GE(chart.at("rows_kept").get<std::size_t>(), lines);
  EXPECT_LT(chart.at("rows_kept").get<std::size_t>(), 48U);
}

TEST_F(ChartAccuracy, NamesWhatItDoesNotKnow) {
  const std::string folder = fresh_folder("chart_refused");
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--scenes", "marmalade"}), 2);
  EXPECT_THAT(error_, HasSubstr("marmalade"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--trajectories", "wobble"}), 2);
  EXPECT_THAT(error_, HasSubstr("wobble"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--conditions", "pigeon"}), 2);
  EXPECT_THAT(error_, HasSubstr("pigeon"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--methods", "hold;magic"}), 1);
  EXPECT_THAT(error_, HasSubstr("'magic' is not known"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--figures", "small/chirp"}), 1);
  EXPECT_THAT(error_, HasSubstr("SCENE/TRAJECTORY/CONDITION"));
  EXPECT_EQ(run({"chart", "accuracy"}), 2);
  EXPECT_THAT(error_, HasSubstr("--out"));
  EXPECT_EQ(run(command(folder, "chirp", "ideal", "tangent")), 1);
  EXPECT_THAT(error_, HasSubstr("add the condition stiffness"));
}

TEST_F(ChartAccuracy, BeginsWithHowAccurateAndUpToWhichStiffness) {
  const std::string folder = fresh_folder("chart_first_screen");
  const std::vector<std::string> arguments{
      "chart",    "accuracy",  "--quick",           "--out",
      folder,     "--cache",   shared_cache,        "--methods",
      "hold;rls", "--figures", "small/chirp/ideal", "--goals-for",
      "rls"};
  ASSERT_EQ(run(arguments), 0) << error_;
  const std::string page = text_of(folder + "/index.html");
  const std::size_t first = page.find("How accurate, at what cost?");
  const std::size_t second = page.find("Up to which stiffness?");
  ASSERT_NE(first, std::string::npos);
  EXPECT_LT(first, second);
  EXPECT_LT(second, page.find("<h2>Goals"));
  const std::string picture = text_of(folder + "/stiffness_over_delay.svg");
  for (const char* const name : {"exact", "hold", "rls", "K &lt; b / age (hold)"}) {
    EXPECT_THAT(picture, HasSubstr(std::string("<text>") + name + "</text>"));
  }
  EXPECT_THAT(out_, HasSubstr(" goals met; "));
  // What a goal misses, and by how much, is no surprise.
  for (const json& number : result(folder).at("numbers")) {
    if (!number.at("measured").is_null()) {
      EXPECT_EQ(number.at("met").get<bool>(), number.at("ratio").get<double>() <= 1.0) << number;
    }
  }
  std::vector<std::string> without = arguments;
  without.emplace_back("--no-stiffness-picture");
  ASSERT_EQ(run(without), 0) << error_;
  EXPECT_EQ(text_of(folder + "/index.html").find("Up to which stiffness?"), std::string::npos);
}

// Two files of one name in two folders, by their paths: every picture is in the chart's folder.
TEST_F(ChartAccuracy, DrawsAnObjectThatIsNamedByAPath) {
  const std::string folder = fresh_folder("chart_of_files");
  std::vector<std::string> files;
  for (const char* const where : {"/one", "/two"}) {
    std::filesystem::create_directories(folder + where);
    files.push_back(folder + where + "/mine.toml");
    std::filesystem::copy_file(paper::tiny_scene("mine", 20.0, 0.3), files.back());
  }
  std::vector<std::string> arguments = command(folder + "/out", "chirp", "ideal", "hold;forcegrid");
  *std::find(arguments.begin(), arguments.end(), "small") = files[0] + "," + files[1];
  arguments.insert(arguments.end(), {"--figures", files[0] + "/chirp/ideal"});
  ASSERT_EQ(run(arguments), 0) << error_;
  EXPECT_EQ(result(folder + "/out").at("rows").size(), 4U);
  std::vector<std::string> drawn;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder + "/out")) {
    if (entry.path().extension() == ".svg") {
      drawn.push_back(std::filesystem::relative(entry.path(), folder + "/out"));
    }
  }
  const std::string digits = "-[0-9a-f]{8}";
  EXPECT_THAT(drawn, IsSupersetOf(
                         {MatchesRegex("error_against_cost.svg"),
                          MatchesRegex("error_against_cost_mine.toml" + digits + ".svg"),
                          MatchesRegex("error_against_cost_mine.toml" + digits + ".svg"),
                          MatchesRegex("figures/mine.toml" + digits + "-chirp-ideal/forces.svg")}));
  EXPECT_THAT(text_of(folder + "/out/index.html"), HasSubstr(files[0] + ", chirp, ideal"));
}

TEST_F(ChartAccuracy, NamesAFolderThatItCantUse) {
  EXPECT_EQ(run(command("/dev/null/chart", "chirp", "ideal", "hold")), 1);
  EXPECT_THAT(error_, HasSubstr("/dev/null/chart"));
}

TEST_F(ChartAccuracy, DirectIsJudgedLiveAndIsTheMostAccurate) {
  const std::string folder = fresh_folder("chart_direct");
  ASSERT_EQ(run(command(folder, "poke", "ideal,delay100", "direct;hold")), 0) << error_;
  const json chart = result(folder);
  const json* direct = row_of(chart, "poke", "ideal", "direct");
  ASSERT_NE(direct, nullptr);
  EXPECT_EQ(row_of(chart, "poke", "delay100", "direct"), nullptr);
  EXPECT_LT(direct->at("rms_error_percent_after_1s"), 0.1);
  EXPECT_LT(direct->at("rms_error_percent_first_1s"), 0.5);
  EXPECT_GT(chart.at("scenes").at(0).at("direct_cycle_us"), 1.0);
}

TEST_F(ChartAccuracy, NamesTheMethodsThatItKnows) {
  const std::string folder = fresh_folder("chart_unknown_method");
  EXPECT_EQ(run(command(folder, "poke", "ideal", "greens")), 1);
  EXPECT_THAT(error_, HasSubstr("method 'greens' is not known; known methods: auto, "));
  EXPECT_THAT(error_, HasSubstr("direct, penetration-depth"));
  EXPECT_EQ(run(command(folder, "poke", "ideal", "greens-functions r=6mm")), 1);
  EXPECT_THAT(error_, HasSubstr("method 'greens-functions' has no options; leave 'r=6mm' out"));
}

// Their order on this object follows from what each leaves out.
TEST_F(ChartAccuracy, RivalsAreJudgedWithWhatTheyComputeBeforehand) {
  const std::string folder = fresh_folder("chart_rivals");
  ASSERT_EQ(run(command(folder, "poke", "ideal,delay100",
                        "penetration-depth;coarse-mesh;unit-responses;greens-functions;"
                        "condensation;two-rates")),
            0)
      << error_;
  const json chart = result(folder);
  const auto figure = [&chart](const char* method, const char* key) {
    const json* const row = row_of(chart, "poke", "ideal", method);
    EXPECT_NE(row, nullptr) << method;
    EXPECT_EQ(row_of(chart, "poke", "delay100", method), nullptr) << method;
    return row == nullptr ? json() : row->at(key);
  };
  constexpr const char* kError = "rms_error_percent_after_1s";
  const double greens = figure("greens-functions", kError).get<double>();
  EXPECT_NEAR(figure("condensation", kError).get<double>(), greens, 1e-6 * greens);
  EXPECT_LT(greens, figure("penetration-depth", kError).get<double>());
  EXPECT_LT(figure("unit-responses", kError).get<double>(), greens);
  EXPECT_LT(figure("two-rates", kError).get<double>(), 0.5);
  EXPECT_LT(figure("coarse-mesh", kError).get<double>(), 30.0);
  for (const char* method :
       {"penetration-depth", "coarse-mesh", "unit-responses", "greens-functions", "condensation"}) {
    EXPECT_GT(figure(method, "precompute_s").get<double>(), 0.0) << method;
  }
  EXPECT_TRUE(figure("two-rates", "precompute_s").is_null());
  EXPECT_GT(figure("condensation", "memory_bytes").get<double>(),
            figure("greens-functions", "memory_bytes").get<double>());
}

}  // namespace
}  // namespace forcegrid
