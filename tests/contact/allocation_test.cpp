// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <random>

#include "contact/near_patch.h"
#include "contact/surface_tree.h"
#include "tests/contact/random_surface.h"
#include "tests/support/allocation_count.h"

namespace forcegrid::contact {
namespace {

constexpr std::uint64_t kSeed = 20260109;

TEST(ContactAllocation, RefitAndQueriesAllocateNothing) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  Surface surface = flat_surface(20, 0.1);
  SurfaceTree tree = surface.tree();
  ToolShape tool = ToolShape::grasper(0.003, 0.02, 0.5);
  int touched = 0;
  int visited = 0;
  const testing::AllocationCount count;
  for (int step = 0; step < 50; ++step) {
    displace(surface, random, 0.001);
    ASSERT_TRUE(tree.refit(surface.positions_W));
    tool.set_opening(0.01 * step);
    const Eigen::Vector3d position_W = random_vector(random, 0.02);
    touched += tree.nearest(tool, position_W, 0.02) ? 1 : 0;
    tree.visit_near(tool, position_W, 0.02, [&visited](std::int32_t) { ++visited; });
  }
  EXPECT_EQ(count.value(), 0U);
  EXPECT_GT(touched, 0);
  EXPECT_GT(visited, 0);
}

TEST(ContactAllocation, ANearPatchAllocatesNothing) {
  constexpr std::array<NearPatch::Vertex, 4> kVertices{
      {{-0.02, -0.02, 0.0}, {0.02, -0.02, 0.0}, {0.02, 0.02, 0.0}, {-0.02, 0.02, 0.0}}};
  constexpr std::array<NearPatch::Triangle, 2> kTriangles{{{0, 1, 2}, {0, 2, 3}}};
  NearPatch patch;
  int near = 0;
  const testing::AllocationCount count;
  ASSERT_TRUE(patch.set(kVertices, kTriangles));
  for (int step = -10; step < 10; ++step) {
    const Eigen::Vector3d position_W(0.001, 0.0, 0.001 * step);
    near += patch.clearance(Capsule{}, position_W, 0.1) ? 1 : 0;
  }
  EXPECT_EQ(count.value(), 0U);
  EXPECT_EQ(near, 20);
}

TEST(ContactAllocation, IsCountedWhereThereIsOne) {
  const testing::AllocationCount count;
  const auto tree = std::make_unique<SurfaceTree>(flat_surface(2, 0.1).tree());
  EXPECT_GT(count.value(), 0U);
  EXPECT_EQ(tree->triangle_count(), 8U);
}

}  // namespace
}  // namespace forcegrid::contact
