// SPDX-License-Identifier: Apache-2.0
#include "contact/tool_shape.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>

#include "contact/distance.h"
#include "contact/error.h"

namespace forcegrid::contact {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kRounding_m = 1e-15;

TEST(ToolShape, EveryToolTouchesAFlatSurfaceBelowItWithItsTip) {
  const Corners plane{Vector3d(-1, -1, 0), Vector3d(1, -1, 0), Vector3d(0, 1, 0)};
  for (const ToolShape& tool :
       {ToolShape::sphere(0.008), ToolShape::capsule(0.004, 0.05),
        ToolShape::capsule(0.004, 0.05, Vector3d(0, 0, 3)), ToolShape::grasper(0.003, 0.02, 0.0)}) {
    const Touch touch = nearest(tool, Vector3d(0.01, 0.02, 0.005), plane);
    EXPECT_NEAR(touch.gap_m, 0.005, kRounding_m);
    EXPECT_TRUE(touch.on_tool_W.isApprox(Vector3d(0.01, 0.02, 0.005), 1e-12));
    EXPECT_TRUE(touch.point_W.isApprox(Vector3d(0.01, 0.02, 0.0), 1e-12));
    EXPECT_TRUE(touch.normal_W.isApprox(Vector3d::UnitZ(), 1e-12));
  }
}

TEST(ToolShape, AnInclinedCapsuleLiesOnItsLowerEnd) {
  const ToolShape tool = ToolShape::capsule(0.004, 0.03, Vector3d(1, 0, 1));
  const Corners plane{Vector3d(-1, -1, 0), Vector3d(1, -1, 0), Vector3d(0, 1, 0)};
  // The lower centre is at r / sqrt(2) above the tip.
  EXPECT_NEAR(nearest(tool, Vector3d::Zero(), plane).gap_m, 0.004 / std::numbers::sqrt2 - 0.004,
              1e-12);
}

TEST(ToolShape, TheJawsOpenByTheirAngleAndMeetInTheHinge) {
  ToolShape tool = ToolShape::grasper(0.002, 0.02, 0.6);
  const auto jaws = tool.parts();
  ASSERT_EQ(jaws.size(), 2U);
  EXPECT_EQ(jaws[0].to_T, jaws[1].to_T);
  EXPECT_NEAR(jaws[0].to_T.z(), 0.022, kRounding_m);
  const Vector3d first = (jaws[0].from_T - jaws[0].to_T).normalized();
  const Vector3d second = (jaws[1].from_T - jaws[1].to_T).normalized();
  EXPECT_NEAR(std::acos(first.dot(second)), 0.6, 1e-12);
  EXPECT_NEAR((jaws[0].from_T - jaws[0].to_T).norm(), 0.02, kRounding_m);
  tool.set_opening(0.0);
  EXPECT_TRUE(tool.parts()[0].from_T.isApprox(Vector3d(0, 0, 0.002), 1e-12));
  tool.set_opening(99.0);
  EXPECT_EQ(tool.opening_rad(), ToolShape::kMaxOpening_rad);
  tool.set_opening(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(tool.opening_rad(), ToolShape::kMaxOpening_rad);
}

TEST(ToolShape, OnlyAGrasperOpens) {
  ToolShape tool = ToolShape::capsule(0.002, 0.02);
  const Vector3d before = tool.parts()[0].from_T;
  tool.set_opening(0.5);
  EXPECT_EQ(tool.opening_rad(), 0.0);
  EXPECT_EQ(tool.parts()[0].from_T, before);
}

// A capsule may be made along any axis, which is another way to turn it.
TEST(ToolShape, ATurnedRodIsTheRodAlongTheTurnedAxis) {
  constexpr unsigned kSeed = 7;
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal;
  ToolShape turned = ToolShape::capsule(0.002, 0.03);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Quaterniond orientation_WT =
        Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
            .normalized();
    turned.set_orientation(orientation_WT);
    const ToolShape made =
        ToolShape::capsule(0.002, 0.03, orientation_WT * Vector3d(0.0, 0.0, 1.0));
    EXPECT_LT((turned.parts()[0].from_T - made.parts()[0].from_T).norm(), 1e-15);
    EXPECT_LT((turned.parts()[0].to_T - made.parts()[0].to_T).norm(), 1e-15);
    EXPECT_NEAR(turned.reach_m(), 0.034, 1e-15);
  }
  turned.set_orientation(Eigen::Quaterniond::Identity());
  EXPECT_EQ(turned.parts()[0].to_T, Vector3d(0.0, 0.0, 0.032));
  turned.set_orientation(Eigen::Quaterniond(1.0, std::numeric_limits<double>::quiet_NaN(), 0, 0));
  turned.set_orientation(Eigen::Quaterniond(0.0, 0.0, 0.0, 0.0));
  EXPECT_EQ(turned.parts()[0].to_T, Vector3d(0.0, 0.0, 0.032)) << "ignored";
}

TEST(ToolShape, ATurnedGrasperOpensInItsOwnPlane) {
  ToolShape tool = ToolShape::grasper(0.002, 0.02, 0.0);
  tool.set_orientation(
      Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi / 2.0, Vector3d::UnitZ())));
  tool.set_opening(1.0);  // by half a radian to both sides of x in T, which is y in W
  EXPECT_NEAR(tool.parts()[0].from_T.x(), 0.0, 1e-15);
  EXPECT_NEAR(tool.parts()[0].from_T.y(), 0.02 * std::sin(0.5), 1e-15);
  EXPECT_NEAR(tool.parts()[1].from_T.y(), -0.02 * std::sin(0.5), 1e-15);
}

TEST(ToolShape, ABladeLiesAcrossItsTip) {
  const ToolShape tool = ToolShape::blade(0.001, 0.03);
  ASSERT_EQ(tool.parts().size(), 1U);
  EXPECT_EQ(tool.parts()[0].from_T, Vector3d(-0.015, 0.0, 0.001));
  EXPECT_EQ(tool.parts()[0].to_T, Vector3d(0.015, 0.0, 0.001));
}

TEST(ToolShape, RefusesSizesOutOfRangeByName) {
  const auto message = [](auto make) -> std::string {
    try {
      make();
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message([] { ToolShape::sphere(0.0); }), HasSubstr("radius"));
  EXPECT_THAT(message([nan] { ToolShape::sphere(nan); }), HasSubstr("radius"));
  EXPECT_THAT(message([] { ToolShape::capsule(0.01, -0.1); }), HasSubstr("length"));
  EXPECT_THAT(message([] { ToolShape::capsule(0.01, 0.1, Vector3d::Zero()); }), HasSubstr("axis"));
  EXPECT_THAT(message([nan] { ToolShape::capsule(0.01, 0.1, Vector3d(0, nan, 1)); }),
              HasSubstr("axis"));
  EXPECT_THAT(message([] { ToolShape::grasper(0.01, 0.005, 0.1); }), HasSubstr("length"));
  EXPECT_THAT(message([] { ToolShape::grasper(0.01, 0.05, -0.1); }), HasSubstr("opening"));
}

}  // namespace
}  // namespace forcegrid::contact
