// SPDX-License-Identifier: Apache-2.0
#include "contact/surface_tree.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <set>
#include <string>

#include "contact/error.h"
#include "tests/contact/random_surface.h"

namespace forcegrid::contact {
namespace {

using Eigen::Vector3d;

constexpr std::uint64_t kSeed = 20260108;

// Every triangle looked at: what the tree has to agree with.
double least_gap_m(const Surface& surface, const ToolShape& tool, const Vector3d& position_W) {
  double least_m = std::numeric_limits<double>::infinity();
  for (const SurfaceTree::Triangle& triangle : surface.triangles) {
    Corners corners;
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = surface.positions_W[static_cast<std::size_t>(triangle[k])];
    }
    least_m = std::min(least_m, nearest(tool, position_W, corners).gap_m);
  }
  return least_m;
}

void expect_same_as_brute_force(const SurfaceTree& tree, const Surface& surface,
                                std::mt19937_64& random) {
  constexpr double kMargin_m = 0.01;
  const ToolShape tool = random_tool(random);
  const Vector3d position_W = random_vector(random, 0.05);
  const double least_m = least_gap_m(surface, tool, position_W);
  const auto found = tree.nearest(tool, position_W, kMargin_m);
  ASSERT_EQ(found.has_value(), least_m <= kMargin_m) << "least gap " << least_m << " m";
  std::set<std::int32_t> seen;
  tree.visit_near(tool, position_W, kMargin_m, [&seen](std::int32_t t) {
    EXPECT_TRUE(seen.insert(t).second) << "triangle " << t << " is visited twice";
  });
  for (std::size_t t = 0; t < tree.triangle_count(); ++t) {
    if (nearest(tool, position_W, tree.corners_W(t)).gap_m <= kMargin_m) {
      ASSERT_TRUE(seen.contains(static_cast<std::int32_t>(t))) << "triangle " << t;
    }
  }
  if (found) {
    ASSERT_EQ(found->touch.gap_m, least_m);
    const auto index = static_cast<std::size_t>(found->triangle);
    ASSERT_EQ(nearest(tool, position_W, tree.corners_W(index)).gap_m, least_m);
  }
}

TEST(SurfaceTree, FindsWhatBruteForceFindsOnSurfacesThatMoveAndFold) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  Surface surface = flat_surface(12, 0.1);
  SurfaceTree tree = surface.tree();
  for (int step = 0; step < 60; ++step) {
    for (int query = 0; query < 5; ++query) {
      expect_same_as_brute_force(tree, surface, random);
    }
    displace(surface, random, 0.003);  // after sixty of them the order of the vertices is gone
    ASSERT_TRUE(tree.refit(surface.positions_W));
  }
}

TEST(SurfaceTree, FindsWhatBruteForceFindsAmongATrianglesOfAnyNumber) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  for (int count = 1; count < 40; ++count) {
    Surface soup;
    for (std::int32_t t = 0; t < count; ++t) {
      const Vector3d centre_W = random_vector(random, 0.04);
      for (int k = 0; k < 3; ++k) {
        soup.positions_W.push_back(centre_W + random_vector(random, 0.01));
      }
      soup.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
    }
    const SurfaceTree tree = soup.tree();
    for (int query = 0; query < 10; ++query) {
      expect_same_as_brute_force(tree, soup, random);
    }
  }
}

TEST(SurfaceTree, GivesTheTouchOfASphereThatPressesIntoAFlatSurface) {
  const SurfaceTree tree = flat_surface(10, 0.1).tree();
  const auto found = tree.nearest(ToolShape::sphere(0.008), {0.013, -0.021, -0.002}, 0.0);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->touch.gap_m, -0.002, 1e-15);
  EXPECT_TRUE(found->touch.point_W.isApprox(Vector3d(0.013, -0.021, 0.0), 1e-12));
  EXPECT_TRUE(found->touch.normal_W.isApprox(Vector3d::UnitZ(), 1e-12));
  EXPECT_FALSE(tree.nearest(ToolShape::sphere(0.008), {0.013, -0.021, 0.002}, 0.001));
}

TEST(SurfaceTree, ManyTrianglesAtOnePlaceAreNoLongerATaskThanOthers) {
  Surface pile;
  pile.positions_W = {Vector3d(0, 0, 0), Vector3d(0.01, 0, 0), Vector3d(0, 0.01, 0)};
  pile.triangles.assign(5000, {0, 1, 2});
  const SurfaceTree tree = pile.tree();
  const auto found = tree.nearest(ToolShape::sphere(0.001), {0.002, 0.002, 0.0005}, 0.01);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->touch.gap_m, 0.0005, 1e-15);
}

TEST(SurfaceTree, WithoutTrianglesAndForAPlaceThatIsNotFiniteThereIsNothing) {
  const SurfaceTree empty({}, {});
  EXPECT_FALSE(empty.nearest(ToolShape::sphere(0.01), Vector3d::Zero(), 1.0));
  const SurfaceTree tree = flat_surface(3, 0.1).tree();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(tree.nearest(ToolShape::sphere(0.01), {0, nan, 0}, 1.0));
  int visited = 0;
  tree.visit_near(ToolShape::sphere(0.01), {0, nan, 0}, 1.0,
                  [&visited](std::int32_t) { ++visited; });
  EXPECT_EQ(visited, 0);
}

TEST(SurfaceTree, RefusesARefitThatIsNoPlaceOfItsVerticesAndKeepsTheOldOne) {
  Surface surface = flat_surface(3, 0.1);
  SurfaceTree tree = surface.tree();
  const ToolShape sphere = ToolShape::sphere(0.005);
  const auto before = tree.nearest(sphere, {0, 0, 0.001}, 0.01);
  surface.positions_W[5].z() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(tree.refit(surface.positions_W));
  surface.positions_W.pop_back();
  EXPECT_FALSE(tree.refit(surface.positions_W));
  const auto after = tree.nearest(sphere, {0, 0, 0.001}, 0.01);
  ASSERT_TRUE(before && after);
  EXPECT_EQ(before->touch.gap_m, after->touch.gap_m);
}

TEST(SurfaceTree, RefusesATriangleOfAVertexThatIsNotThere) {
  const std::vector<Vector3d> places(3, Vector3d::Zero());
  EXPECT_THROW(SurfaceTree({{0, 1, 3}}, places), Error);
  EXPECT_THROW(SurfaceTree({{0, -1, 2}}, places), Error);
  std::vector<Vector3d> broken = places;
  broken[1].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(SurfaceTree({{0, 1, 2}}, broken), Error);
}

}  // namespace
}  // namespace forcegrid::contact
