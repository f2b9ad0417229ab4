// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/rest_surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "simulator/mesh/lattice_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

// A regular octahedron |x| + |y| + |z| <= 1.
SpringMesh octahedron() {
  SpringMesh mesh;
  mesh.rest_position_W = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  mesh.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                    {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  return mesh;
}

TEST(RestSurface, TellsInsideFromOutsideOfAnOctahedronByItsEquation) {
  const RestSurface surface(octahedron());
  constexpr unsigned kSeed = 3;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> at(-1.2, 1.2);
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p_W(at(random), at(random), at(random));
    const double across = std::abs(p_W.x()) + std::abs(p_W.y());
    const RestSurface::Vertical vertical = surface.look(p_W);
    EXPECT_EQ(vertical.inside, across + std::abs(p_W.z()) < 1.0) << p_W.transpose();
    if (across < 1.0 && p_W.z() > 1.0 - across) {
      ASSERT_TRUE(vertical.below_m) << p_W.transpose();
      EXPECT_NEAR(*vertical.below_m, p_W.z() - (1.0 - across), 1e-12);
    }
  }
}

TEST(RestSurface, ALineThroughEdgesAndVerticesCrossesOnce) {
  const RestSurface surface(octahedron());
  for (const double x : {0.0, 0.25, -0.25}) {
    for (const double y : {0.0, 0.5, -0.5}) {
      EXPECT_TRUE(surface.look({x, y, 0.1}).inside) << x << ' ' << y;
      EXPECT_FALSE(surface.look({x, y, 1.1}).inside) << x << ' ' << y;
      EXPECT_FALSE(surface.look({x, y, -1.1}).inside) << x << ' ' << y;
    }
  }
  LatticeBlockOptions options;
  options.vertex_count = {5, 5, 5};
  const RestSurface block(make_lattice_block(options));
  for (int i = -9; i <= 9; ++i) {
    for (int j = -9; j <= 9; ++j) {
      const Vector3d p_W(0.005 * i, 0.005 * j, -0.05);  // on edges, diagonals and vertices, too
      EXPECT_TRUE(block.look(p_W).inside) << p_W.transpose();
      EXPECT_FALSE(block.look(p_W + Vector3d(0, 0, 0.06)).inside) << p_W.transpose();
    }
  }
}

TEST(RestSurface, AStraightPathMeetsTheNearestTriangleFromOutsideOnly) {
  const RestSurface surface(octahedron());
  const auto down = surface.first_hit({0.2, 0.1, 2.0}, {0.0, 0.0, -4.0});
  ASSERT_TRUE(down);
  EXPECT_NEAR(down->z(), 0.7, 1e-12);
  const auto up = surface.first_hit({0.2, 0.1, -2.0}, {0.0, 0.0, 4.0});
  ASSERT_TRUE(up);
  EXPECT_NEAR(up->z(), -0.7, 1e-12);
  EXPECT_FALSE(surface.first_hit({0.2, 0.1, 2.0}, {0.0, 0.0, -1.0})) << "it ends before";
  EXPECT_FALSE(surface.first_hit({0.2, 0.1, 2.0}, {0.0, 0.0, 4.0})) << "away";
  EXPECT_FALSE(surface.first_hit({0.0, 0.1, 0.0}, {0.0, 0.0, 4.0})) << "from inside";
  EXPECT_FALSE(surface.first_hit({1.5, 1.5, 2.0}, {0.0, 0.0, -4.0})) << "beside it";
}

TEST(RestSurface, WithoutTrianglesNothingIsInside) {
  const RestSurface surface{SpringMesh{}};
  EXPECT_FALSE(surface.look(Vector3d::Zero()).inside);
  EXPECT_FALSE(surface.first_hit({0, 0, 1}, {0, 0, -2}));
}

}  // namespace
}  // namespace forcegrid::simulator
