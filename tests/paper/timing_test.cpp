// SPDX-License-Identifier: Apache-2.0
#include "paper/timing.h"

#include <gtest/gtest.h>

#include <numbers>

namespace forcegrid::paper {
namespace {

TEST(Vertices, WithinOneSpacingAreTheCentreAndItsSixNeighbours) {
  const double centre_m[3] = {0.02, 0.02, 0.02};
  const int cells[3] = {4, 4, 4};
  const double extent_m[3] = {0.04, 0.04, 0.04};
  EXPECT_EQ(count_vertices_within(centre_m, 0.0101, cells, extent_m), 7U);
  EXPECT_EQ(count_vertices_within(centre_m, 0.0099, cells, extent_m), 1U);
  const double corner_m[3] = {0.0, 0.0, 0.0};
  EXPECT_EQ(count_vertices_within(corner_m, 0.0101, cells, extent_m), 4U);
}

TEST(Timing, IsOfThePapersGridAndItsSphere) {
  const Timing timing = measure_timing();
  // The sphere's volume over a vertex's share of the workspace.
  const double radius_m = 0.16 / 6.0;
  const double share_m3 = 0.16 * 0.12 * 0.12 / (49.0 * 49.0 * 49.0);
  const double expected = 4.0 / 3.0 * std::numbers::pi * radius_m * radius_m * radius_m / share_m3;
  EXPECT_NEAR(static_cast<double>(timing.vertices_within_r), expected, 0.02 * expected);
  // 125,000 vertices of three floats and a weight at the least.
  EXPECT_GE(timing.memory_bytes, 2'000'000U);
  EXPECT_GT(timing.query_ns, 0.0);
  EXPECT_GT(timing.bare_read_ns, 0.0);
  EXPECT_NEAR(timing.vertex_ns * static_cast<double>(timing.vertices_within_r),
              1e3 * timing.fill_us, 1e-6 * timing.fill_us);
  EXPECT_NEAR(timing.vertices_per_answer, timing.vertices_per_cycle * 500.0 / 30.0,
              1e-6 * timing.vertices_per_answer);
}

}  // namespace
}  // namespace forcegrid::paper
