// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/solver_chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "evaluation/objects/force_table.h"

namespace forcegrid::evaluation {
namespace {

using simulator::SolverScalingRow;
using ::testing::HasSubstr;

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

std::vector<SolverScalingRow> rows() {
  std::vector<SolverScalingRow> result;
  for (const char* solver : {"whole", "local", "two_rates"}) {
    for (const std::size_t vertices : {10'164U, 1'000U, 4'000U}) {
      SolverScalingRow row{.scene = vertices == 4'000U ? "stomach" : "block",
                           .block = vertices != 4'000U,
                           .vertices = vertices,
                           .springs = 8 * vertices,
                           .tetrahedra = 5 * vertices,
                           .motion = {}};
      row.motion.solver = solver;
      row.motion.mean_ms = vertices == 10'164U ? 4.0 : 0.125;  // around a servo cycle
      row.motion.max_ms = 8.0;
      row.motion.vertices_mean = 300.0;
      row.motion.error_percent = 0.0625;
      result.push_back(row);
    }
  }
  return result;
}

TEST(SolverChart, WritesItsRowsAndThePicture) {
  const auto folder = std::filesystem::path(::testing::TempDir()) / "solver_chart" / "deep";
  std::filesystem::remove_all(folder);
  const auto files = write_solver_chart(folder, rows(), 500.0);
  ASSERT_EQ(files.size(), 3U);
  const auto json = nlohmann::json::parse(text_of(files[0]));
  EXPECT_EQ(json.at("rate_Hz"), 500.0);
  ASSERT_EQ(json.at("rows").size(), 9U);
  EXPECT_EQ(json.at("rows")[0].at("time_mean_ms"), 4.0);
  EXPECT_THAT(text_of(files[1]), HasSubstr("\nblock,10164,81312,50820,whole,0,4,0,8,300,0.0625,"));
  const std::string svg = text_of(files[2]);
  for (const char* said : {"two_rates, block", "two_rates, other scenes", "a servo cycle",
                           "vertices touched per cycle, mean", "</svg>"}) {
    EXPECT_THAT(svg, HasSubstr(said));
  }
}

TEST(SolverChart, RefusesToDrawNothingAndAFolderThatCanNotBe) {
  EXPECT_THROW(write_solver_chart(::testing::TempDir(), {}, 500.0), ChartError);
  const auto file = std::filesystem::path(::testing::TempDir()) / "solver_chart_file";
  std::ofstream(file) << "x";
  try {
    write_solver_chart(file / "inside", rows(), 500.0);
    FAIL() << "a file was taken for a folder";
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("--out"));
  }
}

}  // namespace
}  // namespace forcegrid::evaluation
