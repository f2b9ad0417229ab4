// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/tool_motion.h"

#include <gtest/gtest.h>

#include <limits>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

TEST(ToolMotion, FindsTheVelocityOfASteadyMotion) {
  ToolMotion motion;
  const Vector3d velocity_W(0.1, -0.2, 0.05);
  for (int i = 0; i < 200; ++i) {
    EXPECT_TRUE(motion.observe(0.001 * i, 0.001 * i * velocity_W));
  }
  EXPECT_LT((motion.velocity_W() - velocity_W).norm(), 1e-6);
}

TEST(ToolMotion, ForgetsTheVelocityAfterAGap) {
  ToolMotion motion;
  motion.observe(0.0, Vector3d::Zero());
  motion.observe(0.002, Vector3d::UnitX() * 1e-3);
  EXPECT_GT(motion.velocity_W().x(), 0.0);
  motion.observe(0.2, Vector3d::UnitX());
  EXPECT_EQ(motion.velocity_W(), Vector3d::Zero());
  EXPECT_EQ(motion.position_W(), Vector3d::UnitX());
}

TEST(ToolMotion, IgnoresWhatIsNotFinite) {
  ToolMotion motion;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(motion.observe(nan, Vector3d::Zero()));
  EXPECT_FALSE(motion.observe(0.0, Vector3d(0.0, nan, 0.0)));
  EXPECT_FALSE(motion.observed());
}

TEST(ToolMotion, LearnsTheSamplePeriod) {
  ToolMotion motion;
  motion.sample_arrived();  // without an observation there is no clock
  EXPECT_EQ(motion.sample_period_s(), 1.0 / 30.0);
  for (int i = 0; i < 1000; ++i) {
    motion.observe(0.002 * i, Vector3d::Zero());
    if (i % 5 == 0) {
      motion.sample_arrived();
    }
  }
  EXPECT_NEAR(motion.sample_period_s(), 0.010, 1e-6);
}

}  // namespace
}  // namespace forcegrid::kriging
