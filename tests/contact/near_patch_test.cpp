// SPDX-License-Identifier: Apache-2.0
#include "contact/near_patch.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace forcegrid::contact {
namespace {

using Eigen::Vector3d;
using Vertices = std::vector<NearPatch::Vertex>;
using Triangles = std::vector<NearPatch::Triangle>;

constexpr double kTolerance_m = 1e-12;  // rounding only
constexpr double kMargin_m = 1.0;
constexpr std::uint32_t kSeed = 19980405;

const Capsule kPoint{};

Capsule sphere(double radius_m) {
  const Vector3d centre_T(0.0, 0.0, radius_m);
  return {centre_T, centre_T, radius_m};
}

NearPatch patch_of(const Vertices& vertices, const Triangles& triangles) {
  NearPatch patch;
  EXPECT_TRUE(patch.set(vertices, triangles));
  return patch;
}

/// Two triangles on z = 0 from -20 to 20 mm.
NearPatch square() {
  return patch_of({{-0.02, -0.02, 0.0}, {0.02, -0.02, 0.0}, {0.02, 0.02, 0.0}, {-0.02, 0.02, 0.0}},
                  {{0, 1, 2}, {0, 2, 3}});
}

/// A roof that falls by 45 degrees to either side of its ridge, the y axis.
NearPatch roof() {
  return patch_of({{0.0, -0.02, 0.0},
                   {0.0, 0.02, 0.0},
                   {0.02, -0.02, -0.02},
                   {0.02, 0.02, -0.02},
                   {-0.02, -0.02, -0.02},
                   {-0.02, 0.02, -0.02}},
                  {{0, 2, 1}, {2, 3, 1}, {0, 1, 4}, {4, 1, 5}});
}

/// Four faces that fall by 45 degrees from their common corner, the origin.
NearPatch pyramid() {
  return patch_of({{0.0, 0.0, 0.0},
                   {0.02, 0.02, -0.02},
                   {-0.02, 0.02, -0.02},
                   {-0.02, -0.02, -0.02},
                   {0.02, -0.02, -0.02}},
                  {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 1}});
}

TEST(NearPatch, OverAPlaneTheGapIsTheHeightLessNothingOfASphereOnItsTip) {
  const NearPatch patch = square();
  for (const double height_m : {0.003, 1e-6, -1e-6, -0.003}) {
    for (const Capsule& tool : {kPoint, sphere(0.004)}) {
      const auto clearance = patch.clearance(tool, Vector3d(0.003, -0.002, height_m), kMargin_m);
      ASSERT_TRUE(clearance);
      EXPECT_NEAR(clearance->gap_m, height_m, kTolerance_m);
      EXPECT_NEAR((clearance->normal_W - Vector3d::UnitZ()).norm(), 0.0, 1e-9);
      EXPECT_FALSE(clearance->at_rim);
    }
  }
}

TEST(NearPatch, ALyingCapsuleIsHeldAgainstThePlaneByItsLowerEnd) {
  const Capsule tilted{Vector3d(-0.005, 0.0, 0.006), Vector3d(0.005, 0.0, 0.009), 0.002};
  const auto clearance = square().clearance(tilted, Vector3d(0.0, 0.0, 0.001), kMargin_m);
  ASSERT_TRUE(clearance);
  EXPECT_NEAR(clearance->gap_m, 0.001 + 0.006 - 0.002, kTolerance_m);
  EXPECT_NEAR(clearance->point_W.x(), -0.005, kTolerance_m);
}

TEST(NearPatch, OverAnEdgeTheGapIsTheDistanceFromTheEdge) {
  const NearPatch patch = roof();
  // Between the normals of both faces the ridge is what is nearest.
  for (const double angle_rad : {-0.7, -0.2, 0.0, 0.5}) {
    const Vector3d away(std::sin(angle_rad), 0.0, std::cos(angle_rad));
    const auto clearance = patch.clearance(kPoint, 0.004 * away, kMargin_m);
    ASSERT_TRUE(clearance);
    EXPECT_NEAR(clearance->gap_m, 0.004, kTolerance_m) << angle_rad;
    EXPECT_NEAR((clearance->normal_W - away).norm(), 0.0, 1e-9);
    EXPECT_FALSE(clearance->at_rim);
  }
  const auto inside = patch.clearance(kPoint, Vector3d(0.0, 0.0, -0.004), kMargin_m);
  ASSERT_TRUE(inside);
  EXPECT_NEAR(inside->gap_m, -0.004 * std::numbers::sqrt2 / 2.0, kTolerance_m)
      << "the faces are nearer than the ridge";
}

TEST(NearPatch, OverACornerTheGapIsTheDistanceFromTheCorner) {
  const NearPatch patch = pyramid();
  for (const Vector3d& away : {Vector3d(0.0, 0.0, 1.0), Vector3d(0.2, 0.1, 1.0).normalized()}) {
    const auto clearance =
        patch.clearance(sphere(0.002), 0.005 * away - Vector3d(0, 0, 0.002), kMargin_m);
    ASSERT_TRUE(clearance);
    EXPECT_NEAR(clearance->gap_m, 0.005 - 0.002, kTolerance_m);
    EXPECT_NEAR((clearance->normal_W - away).norm(), 0.0, 1e-9);
  }
  const auto inside = patch.clearance(kPoint, Vector3d(0.0, 0.0, -0.003), kMargin_m);
  ASSERT_TRUE(inside);
  EXPECT_NEAR(inside->gap_m, -0.003 * std::numbers::sqrt2 / 2.0, kTolerance_m);
}

TEST(NearPatch, SaysWhereItEnds) {
  const NearPatch patch = square();
  EXPECT_FALSE(patch.clearance(kPoint, Vector3d(0.019, 0.0, 0.01), kMargin_m)->at_rim);
  EXPECT_TRUE(patch.clearance(kPoint, Vector3d(0.021, 0.0, -0.001), kMargin_m)->at_rim);
  EXPECT_TRUE(patch.clearance(kPoint, Vector3d(0.021, 0.021, -0.001), kMargin_m)->at_rim);
  EXPECT_FALSE(patch.clearance(kPoint, Vector3d(0.0, 0.0, 0.01), kMargin_m)->at_rim)
      << "on the edge that both triangles share";
}

TEST(NearPatch, AnswersNothingBeyondTheMarginOrWithoutTriangles) {
  EXPECT_FALSE(square().clearance(kPoint, Vector3d(0.0, 0.0, 0.0051), 0.005));
  EXPECT_TRUE(square().clearance(kPoint, Vector3d(0.0, 0.0, 0.0049), 0.005));
  EXPECT_FALSE(NearPatch().clearance(kPoint, Vector3d::Zero(), kMargin_m));
  EXPECT_FALSE(square().clearance(
      kPoint, Vector3d(0.0, std::numeric_limits<double>::quiet_NaN(), 0.0), kMargin_m));
}

TEST(NearPatch, TakesNoSurfaceThatIsNone) {
  NearPatch patch = square();
  Vertices vertices(NearPatch::kMaxVertices, NearPatch::Vertex{});
  Triangles triangles(NearPatch::kMaxTriangles, NearPatch::Triangle{0, 1, 2});
  EXPECT_TRUE(patch.set(vertices, triangles));
  triangles.push_back({0, 1, 2});
  EXPECT_FALSE(patch.set(vertices, triangles)) << "one triangle too many";
  EXPECT_EQ(patch.triangle_count(), 0U) << "nothing is left of the one before";
  triangles.assign(1, {0, 1, 19});
  EXPECT_FALSE(patch.set(vertices, triangles)) << "a corner that is not there";
  triangles.assign(1, {0, 1, 2});
  vertices[1][2] = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(patch.set(vertices, triangles));
  vertices.assign(NearPatch::kMaxVertices + 1, NearPatch::Vertex{});
  EXPECT_FALSE(patch.set(vertices, triangles)) << "one vertex too many";
}

TEST(NearPatch, TrianglesWithoutAreaHaveNoSide) {
  const NearPatch patch = patch_of({{0, 0, 0}, {0.01, 0, 0}, {0.02, 0, 0}}, {{0, 1, 2}});
  EXPECT_FALSE(patch.clearance(kPoint, Vector3d(0.0, 0.0, 0.001), kMargin_m));
}

/// A field of 4 x 4 random heights, 18 triangles.
struct RandomField {
  explicit RandomField(std::mt19937& random) {
    std::uniform_real_distribution<double> height_m(-0.004, 0.004);
    for (int y = 0; y < 4; ++y) {
      for (int x = 0; x < 4; ++x) {
        vertices.push_back({0.01 * x, 0.01 * y, height_m(random)});
      }
    }
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 3; ++x) {
        const auto at = [&](int dx, int dy) {
          return static_cast<std::uint8_t>(x + dx + 4 * (y + dy));
        };
        triangles.push_back({at(0, 0), at(1, 0), at(1, 1)});
        triangles.push_back({at(0, 0), at(1, 1), at(0, 1)});
      }
    }
  }

  Corners corners_W(const NearPatch::Triangle& triangle) const {
    Corners corners;
    for (std::size_t k = 0; k < 3; ++k) {
      const NearPatch::Vertex& vertex = vertices[triangle[k]];
      corners[k] = {vertex[0], vertex[1], vertex[2]};
    }
    return corners;
  }

  /// Of the surface above or below `position_W`, along a vertical line.
  double height_m(const Vector3d& position_W) const {
    for (const NearPatch::Triangle& triangle : triangles) {
      const Corners c = corners_W(triangle);
      Eigen::Matrix2d sides;
      sides << (c[1] - c[0]).head<2>(), (c[2] - c[0]).head<2>();
      const Eigen::Vector2d part = sides.inverse() * (position_W - c[0]).head<2>();
      if (part.minCoeff() >= 0.0 && part.sum() <= 1.0) {
        return c[0].z() + part[0] * (c[1] - c[0]).z() + part[1] * (c[2] - c[0]).z();
      }
    }
    return std::numeric_limits<double>::quiet_NaN();
  }

  Vertices vertices;
  Triangles triangles;
};

TEST(NearPatch, FindsWhatLookingAtEveryTriangleFinds) {
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> across_m(0.0, 0.03);
  std::uniform_real_distribution<double> up_m(-0.01, 0.01);
  int inside = 0;
  int outside = 0;
  for (int i = 0; i < 4000; ++i) {
    const RandomField field(random);
    const NearPatch patch = patch_of(field.vertices, field.triangles);
    const Vector3d position_W(across_m(random), across_m(random), up_m(random));
    Capsule tool = i % 2 == 0 ? kPoint : sphere(0.003);
    if (i % 4 == 3) {
      tool.to_T += Vector3d(up_m(random), up_m(random), up_m(random));
    }
    double nearest_m = std::numeric_limits<double>::infinity();
    for (const NearPatch::Triangle& triangle : field.triangles) {
      nearest_m = std::min(nearest_m, nearest(position_W + tool.from_T, position_W + tool.to_T,
                                              field.corners_W(triangle))
                                          .distance_m);
    }
    const auto clearance = patch.clearance(tool, position_W, kMargin_m);
    ASSERT_TRUE(clearance);
    EXPECT_NEAR(std::abs(clearance->gap_m + tool.radius_m), nearest_m, 1e-12);
    if (i % 2 == 0 && !clearance->at_rim) {
      const bool above = position_W.z() > field.height_m(position_W);
      EXPECT_EQ(clearance->gap_m > 0.0, above) << "case " << i;
      ++(above ? outside : inside);
    }
    ASSERT_FALSE(HasFailure()) << "case " << i;
  }
  EXPECT_GT(inside, 500);
  EXPECT_GT(outside, 500);
}

}  // namespace
}  // namespace forcegrid::contact
