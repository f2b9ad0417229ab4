// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/solver_scaling.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

using ::testing::ElementsAre;

TEST(SolverScaling, TakesTheBlockThatIsNearest) {
  EXPECT_THAT(block_counts(1'000), ElementsAre(10, 10, 10));
  EXPECT_THAT(block_counts(10'000), ElementsAre(22, 22, 21));
  EXPECT_THAT(block_counts(100'000), ElementsAre(47, 46, 46));
  EXPECT_THAT(block_counts(1'000'000), ElementsAre(100, 100, 100));
  EXPECT_THROW(block_counts(999), Error);
  EXPECT_THROW(block_counts(1'000'001), Error);
}

TEST(SolverScaling, TheBlockOfTenThousandIsTheSceneBlock) {
  const Scene expected = make_scene("block");
  const Scene found = block_of_size(10'000);
  ASSERT_EQ(found.mesh.springs.size(), expected.mesh.springs.size());
  EXPECT_EQ(found.mesh.rest_position_W, expected.mesh.rest_position_W);
  EXPECT_EQ(found.patch_radius_m, expected.patch_radius_m);
}

TEST(SolverScaling, MeasuresEachSolverOnEachObject) {
  SolverScalingOptions options;
  options.block_sizes = {1'000};
  options.scenes = {"small_linear"};
  for (int cycle = 0; cycle < 60; ++cycle) {
    const double phase = 0.03 * cycle;
    options.displacements_W.emplace_back(0.005 * std::sin(phase), 0.0,
                                         0.005 * (1.0 - std::cos(phase)));
  }
  options.settling_s = 0.02;
  const std::vector<SolverScalingRow> rows = bench_scaling(options);
  ASSERT_EQ(rows.size(), 6U);
  for (const SolverScalingRow& row : rows) {
    EXPECT_EQ(row.block, row.scene == "block");
    EXPECT_EQ(row.vertices, row.block ? 1'000U : 1'089U);
    EXPECT_EQ(row.motion.ticks, 50U);
    EXPECT_LT(row.motion.error_percent, 2.0) << row.scene << ' ' << row.motion.solver;
    EXPECT_EQ(row.motion.whole_mean_ms > 0.0, row.motion.solver == "two_rates");
    if (row.motion.solver == "whole") {
      EXPECT_EQ(row.motion.vertices_mean, static_cast<double>(row.vertices));
    }
  }
}

TEST(SolverScaling, LeavesOutASceneWhoseMeshIsMissingAndSaysSo) {
  const std::string file = ::testing::TempDir() + "no_liver.toml";
  std::ofstream(file) << R"(description = "Not meshed yet"
[[object]]
shape = "mesh"
file = "no_liver.msh"
unit = "mm"
fixed_below_m = 0.02
[object.material]
model = "neo_hookean"
youngs_modulus_Pa = 5500.0
poissons_ratio = 0.45
density_kg_per_m3 = 1060.0
)";
  std::vector<std::string> said;
  const auto found = scenes_at_hand({"small_linear", file, "small"},
                                    [&](const std::string& line) { said.push_back(line); });
  EXPECT_THAT(found, ElementsAre("small_linear", "small"));
  ASSERT_EQ(said.size(), 1U);
  EXPECT_THAT(said[0], ::testing::StartsWith(file + " is left out: "));
  EXPECT_THAT(said[0], ::testing::HasSubstr("no_liver.msh"));
}

TEST(SolverScaling, AMeshThatIsThereAndBrokenIsAnError) {
  const std::string file = ::testing::TempDir() + "broken_liver.toml";
  std::ofstream(file) << "description = \"Broken\"\n[[object]]\nshape = \"mesh\"\n"
                         "file = \"broken_liver.msh\"\nunit = \"mm\"\nfixed_below_m = 0.02\n"
                         "stiffness_N_per_m = 20.0\nlaw = \"linear\"\n";
  std::ofstream(::testing::TempDir() + "broken_liver.msh") << "no mesh\n";
  try {
    scenes_at_hand({file}, [](const std::string& line) { ADD_FAILURE() << line; });
    FAIL() << "a mesh that is no mesh was taken";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("$MeshFormat"));
  }
}

TEST(SolverScaling, RefusesAMotionThatIsTooShort) {
  SolverScalingOptions options;
  options.block_sizes = {};
  options.scenes = {"small_linear"};
  EXPECT_THROW(bench_scaling(options), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
