// SPDX-License-Identifier: Apache-2.0
#include "paper/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "evaluation/charts/page_text.h"
#include "paper/paper.h"
#include "paper/tables.h"
#include "tests/paper/tiny_scenes.h"

namespace forcegrid::paper {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

const Claim& claim_of(const std::vector<Claim>& claims, const std::string& topic) {
  for (const Claim& claim : claims) {
    if (claim.topic == topic) {
      return claim;
    }
  }
  throw std::out_of_range(topic + " is not among the claims");
}

// The experiments on cubes of 100 vertices, run once.
class Report : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_options = new PaperOptions;
    shared_options->jobs = 1;
    shared_options->out = ::testing::TempDir() + "paper_out_" + std::to_string(getpid());
    fs::remove_all(shared_options->out);
    shared_options->plan.scene = tiny_scene("organ", 20.0, 0.3);
    shared_options->plan.motions = {"chirp"};
    shared_options->plan.compared_scenes = {tiny_scene("stomach", 30.0, 0.2)};
    shared_options->plan.vertices = {25, 50};
    shared_options->plan.radii_of_workspace = {1.0 / 24, 1.0 / 6};
    shared_options->plan.touches = 2;
    shared_options->plan.contrasts = {1.0};
    shared_options->plan.objects = {tiny_scene("stiff", 60.0, 0.1), tiny_scene("soft", 20.0, 0.1),
                                    tiny_scene("varied", 35.0, 0.9)};
    shared_results = new Results(run_experiments(*shared_options));
  }
  static void TearDownTestSuite() {
    fs::remove_all(shared_options->out);
    delete shared_results;
    delete shared_options;
  }
  static PaperOptions* shared_options;
  static Results* shared_results;
};

PaperOptions* Report::shared_options = nullptr;
Results* Report::shared_results = nullptr;

TEST_F(Report, WritesTablesPicturesAndAPageThatNeedsNothingElse) {
  const std::vector<fs::path> files = write_report(*shared_results, *shared_options);
  EXPECT_EQ(files.back().filename(), "index.html");
  for (const char* name : {"claims.csv", "figure7.csv", "comparison.csv", "resolutions.csv",
                           "discrimination.csv", "shapes.csv", "paper.json", "figure7.svg",
                           "figure8.svg", "resolutions.svg", "discrimination.svg"}) {
    EXPECT_GT(fs::file_size(shared_options->out / name), 100U) << name;
  }
  const std::string page = evaluation::read_text(files.back());
  EXPECT_EQ(std::count(page.begin(), page.end(), '\n') > 10, true);
  std::size_t pictures = 0;
  for (std::size_t at = page.find("<svg"); at != std::string::npos;
       at = page.find("<svg", at + 1)) {
    ++pictures;
  }
  EXPECT_EQ(pictures, 4U);
  for (const Claim& claim : claims_of(*shared_results)) {
    EXPECT_THAT(page, HasSubstr(evaluation::escaped(claim.here))) << claim.topic;
  }
  const std::string forces = evaluation::read_text(shared_options->out / "figure7.csv");
  EXPECT_EQ(std::count(forces.begin(), forces.end(), '\n'), 10001);
  const nlohmann::json json =
      nlohmann::json::parse(evaluation::read_text(shared_options->out / "paper.json"));
  EXPECT_EQ(json.at("claims").size(), claims_of(*shared_results).size());
  EXPECT_EQ(json.at("resolutions").size(), 4U);
  EXPECT_EQ(json.at("figures").at("fifths").size(), 5U);
  EXPECT_EQ(json.at("comparison").at("rows").size(), 24U);
  EXPECT_THAT(page, HasSubstr("The methods that the paper names"));
  EXPECT_EQ(json.at("figures").at("offline_unconverged"), 0);
  EXPECT_EQ(json.at("discrimination").at("objects").size(), 3U);
  EXPECT_EQ(json.at("shapes").size(), 3U);
}

// The method study's figures for this motion: streaming 37 %, forcegrid with d in mm 11 %, in
// metres 47 %, all after the first second and of objects of other sizes.
TEST_F(Report, HasTheFiguresErrorsThatTheMethodStudyFound) {
  const Figures& figures = shared_results->figures;
  ASSERT_EQ(figures.played.size(), figure_methods().size());
  EXPECT_NEAR(figures.played[0].verdict.rms_error_percent_after_1s, 36.8, 6.0);
  EXPECT_NEAR(figures.played[1].verdict.rms_error_percent_after_1s, 10.8, 3.0);
  EXPECT_NEAR(figures.played[2].verdict.rms_error_percent_after_1s, 47.0, 6.0);
  EXPECT_NEAR(figures.blind_s, 2.0 / 30.0, 1e-9);
  // The same method, resolution and r, by another way.
  for (const ResolutionRow& row : shared_results->resolutions) {
    if (row.vertices == 50 && row.radius_of_workspace > 0.1) {
      EXPECT_NEAR(row.rms_error_percent, figures.played[1].verdict.rms_error_percent_after_1s,
                  1e-3);
    }
  }
}

TEST_F(Report, ComparesEveryMethodThatThePaperNames) {
  const Comparison& comparison = shared_results->comparison;
  ASSERT_EQ(comparison.rows.size(), 24U);
  for (const ComparisonRow& row : comparison.rows) {
    EXPECT_EQ(row.not_judged, "") << row.method;
    EXPECT_TRUE(std::isfinite(row.error_percent)) << row.method;
    EXPECT_GT(row.cycle_over_bare_read, 0.0) << row.method;
    EXPECT_GT(row.memory_MB, 0.0) << row.method;
    EXPECT_FALSE(row.stands_for.empty() || row.needs.empty() || row.right_when.empty());
  }
  // The same method, played by another experiment.
  EXPECT_EQ(comparison.rows.front().method, "forcegrid");
  EXPECT_NEAR(comparison.rows.front().error_percent,
              shared_results->figures.played[1].verdict.rms_error_percent_after_1s, 1e-9);
  ASSERT_EQ(comparison.which_to_take.size(), 3U);
  const std::string page =
      evaluation::read_text(write_report(*shared_results, *shared_options).back());
  for (const std::string& sentence : comparison.which_to_take) {
    EXPECT_THAT(page, HasSubstr(evaluation::escaped(sentence)));
  }
}

ComparisonRow compared(const char* motion, const char* method, double error_percent) {
  ComparisonRow row;
  row.motion = motion;
  row.method = method;
  row.right_when = "right";
  row.error_percent = error_percent;
  row.cycle_over_bare_read = 10.0;
  row.precompute_s = 2.0;
  row.memory_MB = 3.0;
  return row;
}

TEST(WhichToTake, IsTheSmallestWorstErrorOfEachGroup) {
  const std::vector<ComparisonRow> rows{compared("a", "forcegrid", 9.0),
                                        compared("b", "forcegrid", 30.0),
                                        compared("a", "auto", 0.1),
                                        compared("b", "auto", 0.2),
                                        compared("a", "rls", 0.05),
                                        compared("b", "rls", 0.4),
                                        compared("a", "greens-functions", 20.0),
                                        compared("b", "greens-functions", 22.0),
                                        compared("a", "penetration-depth", 1.0),
                                        compared("b", "penetration-depth", 70.0),
                                        compared("a", "unit-responses", std::nan("")),
                                        compared("b", "unit-responses", 1.0),
                                        compared("a", "two-rates", 0.3),
                                        compared("b", "two-rates", 0.1)};
  const std::vector<std::string> sentences = which_to_take(rows);
  ASSERT_EQ(sentences.size(), 3U);
  EXPECT_THAT(sentences[0], HasSubstr("take auto (0.200 % at worst"));
  EXPECT_THAT(sentences[0], HasSubstr("forcegrid: 30.0 %"));
  EXPECT_THAT(sentences[1], HasSubstr("take greens-functions (22.0 % at worst"));
  EXPECT_THAT(sentences[1], HasSubstr("2.00 s beforehand, 3.00 MB), and only where right."));
  EXPECT_THAT(sentences[2], HasSubstr("take two-rates (0.300 % at worst"));
  EXPECT_THAT(sentences[2], HasSubstr("no more accurate than auto"));
  EXPECT_THAT(which_to_take({})[1],
              HasSubstr("No method of tables made beforehand was judged everywhere"));
}

TEST_F(Report, ClaimsFollowTheNumbers) {
  EXPECT_EQ(claim_of(claims_of(*shared_results), "Figure 8, streaming").outcome, Outcome::kAgrees);
  EXPECT_EQ(claim_of(claims_of(*shared_results), "Figure 7, forcegrid").outcome, Outcome::kDiffers);
  Results other = *shared_results;
  other.figures.fifths[3].rms_error_percent[0] = other.figures.fifths[2].rms_error_percent[0] - 1.0;
  EXPECT_EQ(claim_of(claims_of(other), "Figure 8, streaming").outcome, Outcome::kDiffers);
  other.figures.fifths[4].rms_error_percent[1] = 1.0;
  EXPECT_EQ(claim_of(claims_of(other), "Figure 7, forcegrid").outcome, Outcome::kAgrees);
  other.timing.vertices_per_cycle = 1999.0;
  EXPECT_EQ(claim_of(claims_of(other), "Vertices a cycle").outcome, Outcome::kDiffers);
  other.timing.memory_bytes = 999'999;
  EXPECT_EQ(claim_of(claims_of(other), "Memory of the grid").outcome, Outcome::kAgrees);
  for (DiscriminationRow& row : other.discrimination.rows) {
    row.answers = {50, 100};
  }
  EXPECT_EQ(claim_of(claims_of(other), "Three objects, forcegrid").outcome, Outcome::kDiffers);
  for (DiscriminationRow& row : other.discrimination.rows) {
    row.answers = {100, 100};
  }
  EXPECT_EQ(claim_of(claims_of(other), "Three objects, forcegrid").outcome, Outcome::kAgrees);
  other.shapes[0].d_prime = 2.0;
  EXPECT_EQ(claim_of(claims_of(other), "By eye alone, stiff and soft").outcome, Outcome::kDiffers);
}

TEST(Csv, QuotesTextsAndLeavesOutWhatIsNotFinite) {
  Table table{{"name", "value_N"}, {}};
  table.rows.push_back({std::string("a \"soft\", one"), 0.25});
  table.rows.push_back({std::string("b"), std::nan("")});
  EXPECT_EQ(csv(table), "name,value_N\n\"a \"\"soft\"\", one\",0.25\n\"b\",\n");
}

}  // namespace
}  // namespace forcegrid::paper
