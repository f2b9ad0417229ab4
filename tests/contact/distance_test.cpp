// SPDX-License-Identifier: Apache-2.0
#include "contact/distance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/contact/random_surface.h"

namespace forcegrid::contact {
namespace {

using Eigen::Vector3d;

constexpr std::uint64_t kSeed = 20260107;
constexpr double kRounding = 1e-12;

const Corners kTriangle{Vector3d(0, 0, 0), Vector3d(1, 0, 0), Vector3d(0, 1, 0)};

Vector3d at(const Corners& corners, const Vector3d& weights) {
  return weights[0] * corners[0] + weights[1] * corners[1] + weights[2] * corners[2];
}

Corners random_corners(std::mt19937_64& random) {
  return {random_vector(random, 1.0), random_vector(random, 1.0), random_vector(random, 1.0)};
}

// The least distance of 100 points of the segment from 1,275 of the triangle, and how far from the
// true minimum that can be.
struct Sampled {
  double distance = 1e9;
  double slack = 0.0;
};
Sampled sampled_distance(const Vector3d& from, const Vector3d& to, const Corners& corners) {
  constexpr int kAlong = 100;
  constexpr int kAcross = 50;
  Sampled result;
  double longest = 0.0;
  for (std::size_t k = 0; k < 3; ++k) {
    longest = std::max(longest, (corners[k] - corners[(k + 1) % 3]).norm());
  }
  result.slack = (to - from).norm() / kAlong + longest / kAcross;
  for (int i = 0; i <= kAcross; ++i) {
    for (int j = 0; i + j <= kAcross; ++j) {
      const Vector3d weights(1.0 - static_cast<double>(i + j) / kAcross,
                             static_cast<double>(i) / kAcross, static_cast<double>(j) / kAcross);
      const Vector3d point = at(corners, weights);
      for (int s = 0; s <= kAlong; ++s) {
        const double t = static_cast<double>(s) / kAlong;
        result.distance = std::min(result.distance, (point - (1 - t) * from - t * to).norm());
      }
    }
  }
  return result;
}

TEST(NearestWeights, AreTheClosedFormsOverFaceEdgeAndCorner) {
  EXPECT_TRUE(nearest_weights({0.25, 0.25, 3.0}, kTriangle).isApprox(Vector3d(0.5, 0.25, 0.25)));
  EXPECT_TRUE(nearest_weights({0.25, -2.0, 1.0}, kTriangle).isApprox(Vector3d(0.75, 0.25, 0.0)));
  EXPECT_TRUE(nearest_weights({1.0, 1.0, 0.5}, kTriangle).isApprox(Vector3d(0.0, 0.5, 0.5)));
  EXPECT_TRUE(nearest_weights({-1.0, -1.0, 7.0}, kTriangle).isApprox(Vector3d::UnitX()));
  EXPECT_TRUE(nearest_weights({-0.1, 5.0, 0.0}, kTriangle).isApprox(Vector3d::UnitZ()));
}

TEST(NearestWeights, OfATriangleWithoutAreaAreThoseOfItsEdges) {
  const Corners line{Vector3d(0, 0, 0), Vector3d(1, 0, 0), Vector3d(2, 0, 0)};
  EXPECT_TRUE(at(line, nearest_weights({1.5, 1.0, 0.0}, line)).isApprox(Vector3d(1.5, 0, 0)));
  const Corners point{Vector3d(1, 1, 1), Vector3d(1, 1, 1), Vector3d(1, 1, 1)};
  EXPECT_TRUE(at(point, nearest_weights({0, 0, 0}, point)).isApprox(Vector3d(1, 1, 1)));
}

TEST(AxisToTriangle, IsTheClosedFormInEveryConstellation) {
  // Above the face, upright; through the face; parallel beside an edge; end over a corner.
  EXPECT_NEAR(nearest({0.2, 0.2, 0.3}, {0.2, 0.2, 1.0}, kTriangle).distance_m, 0.3, kRounding);
  const AxisToTriangle through = nearest({0.2, 0.3, -1.0}, {0.2, 0.3, 0.5}, kTriangle);
  EXPECT_EQ(through.distance_m, 0.0);
  EXPECT_TRUE(through.on_triangle.isApprox(Vector3d(0.2, 0.3, 0.0)));
  EXPECT_NEAR(nearest({-1.0, -0.4, 0.3}, {2.0, -0.4, 0.3}, kTriangle).distance_m, 0.5, kRounding);
  EXPECT_NEAR(nearest({1.3, 0.0, 0.4}, {2.0, 0.0, 0.4}, kTriangle).distance_m, 0.5, kRounding);
  // Crossing the plane outside of the triangle: the nearest is on the slanted edge.
  EXPECT_NEAR(nearest({1.0, 1.0, -1.0}, {1.0, 1.0, 1.0}, kTriangle).distance_m, std::sqrt(0.5),
              kRounding);
}

TEST(AxisToTriangle, IsNeverFartherThanAnySampledPairAndIsAPairItself) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  for (int trial = 0; trial < 150; ++trial) {
    const Corners corners = random_corners(random);
    const Vector3d from = random_vector(random, 1.5);
    const Vector3d to = trial % 5 == 0 ? from : random_vector(random, 1.5);
    const AxisToTriangle pair = nearest(from, to, corners);
    const Sampled sampled = sampled_distance(from, to, corners);
    ASSERT_LE(pair.distance_m, sampled.distance + kRounding) << "trial " << trial;
    ASSERT_GE(pair.distance_m, sampled.distance - sampled.slack) << "trial " << trial;
    ASSERT_NEAR((pair.on_axis - pair.on_triangle).norm(), pair.distance_m, kRounding);
    ASSERT_TRUE(at(corners, pair.weights).isApprox(pair.on_triangle, kRounding));
    ASSERT_NEAR(pair.weights.sum(), 1.0, kRounding);
    ASSERT_GE(pair.weights.minCoeff(), -kRounding);
    const double length = (to - from).norm();
    ASSERT_NEAR((pair.on_axis - from).norm() + (pair.on_axis - to).norm(), length, 1e-9);
  }
}

TEST(Touch, OfASphereAndAPlaneIsItsHeightLessItsRadiusUntilTheCentreIsThrough) {
  const Corners plane{Vector3d(-9, -9, 0), Vector3d(9, -9, 0), Vector3d(0, 9, 0)};
  const ToolShape sphere = ToolShape::sphere(0.01);
  for (const double tip_m : {0.02, 0.001, 0.0, -0.004, -0.0099}) {
    const Touch touch = nearest(sphere, {0.3, 0.2, tip_m}, plane);
    EXPECT_NEAR(touch.gap_m, tip_m, kRounding);
    EXPECT_TRUE(touch.normal_W.isApprox(Vector3d::UnitZ(), 1e-9));
  }
  const Touch centred = nearest(sphere, {0.3, 0.2, -0.01}, plane);
  EXPECT_NEAR(centred.gap_m, -0.01, kRounding);
  EXPECT_TRUE(centred.normal_W.isApprox(Vector3d::UnitZ()));
}

TEST(Touch, OfAGrasperNamesTheJawThatIsNearer) {
  const ToolShape grasper = ToolShape::grasper(0.002, 0.02, 1.0);
  const auto beside = [](double x) {
    return Corners{Vector3d(x, -1, -1), Vector3d(x, 1, -1), Vector3d(x, 0, 2)};
  };
  const double reach_m = 0.02 * std::sin(0.5) + 0.002;
  const Touch right = nearest(grasper, Vector3d::Zero(), beside(0.05));
  EXPECT_EQ(right.part, 0);
  EXPECT_NEAR(right.gap_m, 0.05 - reach_m, kRounding);
  const Touch left = nearest(grasper, Vector3d::Zero(), beside(-0.03));
  EXPECT_EQ(left.part, 1);
  EXPECT_NEAR(left.gap_m, 0.03 - reach_m, kRounding);
}

TEST(PointInTool, IsTheClosedFormOfSphereAndCapsule) {
  const ToolShape sphere = ToolShape::sphere(0.01);
  const PointInTool inside = locate(sphere, {0, 0, 0}, {0.003, 0.0, 0.014});
  EXPECT_NEAR(inside.gap_m, 0.005 - 0.01, kRounding);
  EXPECT_TRUE(inside.normal_W.isApprox(Vector3d(0.6, 0.0, 0.8)));
  EXPECT_NEAR(inside.turning_W_per_m.trace(), 2.0 / 0.005, 1e-6);
  const ToolShape capsule = ToolShape::capsule(0.002, 0.03);
  EXPECT_NEAR(locate(capsule, {0, 0, 0}, {0.005, 0.0, 0.01}).gap_m, 0.003, kRounding);
  EXPECT_NEAR(locate(capsule, {0, 0, 0}, {0.0, 0.003, 0.036}).gap_m, 0.003, kRounding);
  EXPECT_NEAR(locate(capsule, {0, 0, 0}, {0.0, 0.0, 0.01}).normal_W.norm(), 1.0, kRounding);
}

TEST(PointInTool, ItsNormalIsTheGapsGradientAndTurnsAsTheSecondDerivativeSays) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  constexpr double kStep_m = 1e-7;
  int compared = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const ToolShape tool = random_tool(random);
    const Vector3d place = random_vector(random, 0.01);
    const Vector3d point = random_vector(random, 0.04);
    const PointInTool here = locate(tool, place, point);
    Vector3d gradient = Vector3d::Zero();
    Eigen::Matrix3d turning = Eigen::Matrix3d::Zero();
    for (int c = 0; c < 3; ++c) {
      const Vector3d step = kStep_m * Vector3d::Unit(c);
      const PointInTool ahead = locate(tool, place, point + step);
      const PointInTool behind = locate(tool, place, point - step);
      gradient[c] = (ahead.gap_m - behind.gap_m) / (2.0 * kStep_m);
      turning.col(c) = (ahead.normal_W - behind.normal_W) / (2.0 * kStep_m);
    }
    if (std::abs(gradient.norm() - 1.0) > 1e-4) {
      continue;  // across the middle plane of a grasper, or an axis
    }
    ++compared;
    EXPECT_LT((here.normal_W - gradient).norm(), 1e-3) << "trial " << trial;
    EXPECT_LT((here.turning_W_per_m - turning).norm(), 1e-3 * (1.0 + turning.norm()))
        << "trial " << trial;
  }
  EXPECT_GT(compared, 280);
}

// Of two upright capsules and two crossed ones the nearest points are known.
TEST(ToolToTool, GapsOfRodsInClosedForm) {
  const ToolShape upright = ToolShape::capsule(0.002, 0.040);
  // The axes are 5 mm apart beside each other.
  const ToolToTool beside = nearest(upright, {0.003, 0.004, 0.02}, upright, {0.0, 0.0, 0.0});
  EXPECT_NEAR(beside.gap_m, 0.001, 1e-15);
  EXPECT_LT((beside.normal_W - Eigen::Vector3d(0.6, 0.8, 0.0)).norm(), 1e-12);
  // One above the other: 40 mm of axis, then 3 mm.
  const ToolToTool above = nearest(upright, {0.0, 0.0, 0.043}, upright, {0.0, 0.0, 0.0});
  EXPECT_NEAR(above.gap_m, -0.001, 1e-15);
  EXPECT_LT((above.normal_W - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
  // Crossed at right angles, 10 mm apart along y.
  const ToolShape lying = ToolShape::capsule(0.003, 0.100, Eigen::Vector3d::UnitX());
  const ToolToTool crossed = nearest(lying, {-0.05, 0.010, 0.02}, upright, {0.0, 0.0, 0.0});
  EXPECT_NEAR(crossed.gap_m, 0.010 - 0.005, 1e-12);
  EXPECT_LT((crossed.normal_W - Eigen::Vector3d::UnitY()).norm(), 1e-9);
}

TEST(ToolToTool, IsOppositeSeenFromTheOther) {
  const ToolShape grasper = ToolShape::grasper(0.004, 0.03, 0.5);
  const ToolShape ball = ToolShape::sphere(0.006);
  const Eigen::Vector3d at_W(0.011, -0.004, 0.013);
  const ToolToTool one = nearest(grasper, at_W, ball, {0.0, 0.0, 0.0});
  const ToolToTool other = nearest(ball, {0.0, 0.0, 0.0}, grasper, at_W);
  EXPECT_NEAR(one.gap_m, other.gap_m, 1e-15);
  EXPECT_LT((one.normal_W + other.normal_W).norm(), 1e-12);
}

// The normal is the gap's gradient, so that a force along it has a potential.
TEST(ToolToTool, TheNormalIsTheGapsGradient) {
  const ToolShape grasper = ToolShape::grasper(0.004, 0.03, 0.5);
  const Eigen::Vector3d at_W(0.009, -0.007, 0.021);
  const ToolToTool found = nearest(grasper, at_W, grasper, {0.0, 0.0, 0.0});
  constexpr double kStep_m = 1e-6;
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::Vector3d ahead_W = at_W;
    Eigen::Vector3d behind_W = at_W;
    ahead_W[axis] += kStep_m;
    behind_W[axis] -= kStep_m;
    const double slope = (nearest(grasper, ahead_W, grasper, {0.0, 0.0, 0.0}).gap_m -
                          nearest(grasper, behind_W, grasper, {0.0, 0.0, 0.0}).gap_m) /
                         (2.0 * kStep_m);
    EXPECT_NEAR(found.normal_W[axis], slope, 1e-6);
  }
}

}  // namespace
}  // namespace forcegrid::contact
