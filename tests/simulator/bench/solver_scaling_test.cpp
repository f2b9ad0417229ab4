// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/solver_scaling.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

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

TEST(SolverScaling, RefusesAMotionThatIsTooShort) {
  SolverScalingOptions options;
  options.block_sizes = {};
  options.scenes = {"small_linear"};
  EXPECT_THROW(bench_scaling(options), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
