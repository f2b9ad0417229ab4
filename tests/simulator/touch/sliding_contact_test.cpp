// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/sliding_contact.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {
namespace {

using contact::ToolShape;
using Eigen::Vector3d;
using ::testing::HasSubstr;

class SlidingContactTest : public ::testing::Test {
 protected:
  SpringMesh mesh_ = make_scene("small").mesh;
  SlidingContact sphere_{mesh_, ToolShape::sphere(0.012), {}};
};

TEST_F(SlidingContactTest, TouchesPressesAndLeavesWithAnEpochEach) {
  const auto above = sphere_.step({0.0, 0.0, 0.005});
  EXPECT_FALSE(above.in_contact);
  EXPECT_EQ(above.epoch, 0U);
  EXPECT_TRUE(above.equilibrium.converged);
  const auto pressed = sphere_.step({0.002, 0.0, -0.001});
  EXPECT_TRUE(pressed.in_contact);
  EXPECT_EQ(pressed.epoch, 1U);
  EXPECT_GT(pressed.equilibrium.force_W.z(), 0.0);
  // Straight down from 5 mm above, it touched after five sixths of the way.
  EXPECT_NEAR(pressed.point_W.z(), 0.0, 2e-6);
  EXPECT_NEAR(pressed.point_W.x(), 0.002 * 5.0 / 6.0, 1e-5);
  const auto deeper = sphere_.step({0.002, 0.0, -0.002});
  EXPECT_EQ(deeper.epoch, 1U) << "no discontinuity";
  EXPECT_EQ(deeper.point_W, pressed.point_W);
  const auto away = sphere_.step({0.002, 0.0, 0.002});
  EXPECT_FALSE(away.in_contact);
  EXPECT_EQ(away.epoch, 2U);
  EXPECT_EQ(away.equilibrium.force_W, Vector3d::Zero());
  EXPECT_EQ(sphere_.step({0.002, 0.0, -0.001}).epoch, 3U);
  sphere_.reset();
  EXPECT_EQ(sphere_.step({0.0, 0.0, 0.005}).epoch, 0U);
}

TEST_F(SlidingContactTest, AToolThatIsFirstSeenInsideMustComeOutBeforeItCanTouch) {
  EXPECT_FALSE(sphere_.step({0.0, 0.0, -0.02}).in_contact);
  EXPECT_FALSE(sphere_.step({0.0, 0.0, -0.005}).in_contact);
  EXPECT_FALSE(sphere_.step({0.0, 0.0, 0.001}).in_contact);
  EXPECT_TRUE(sphere_.step({0.0, 0.0, -0.001}).in_contact);
}

TEST_F(SlidingContactTest, ForetellsWhereTheToolWillBeWhenItTouches) {
  sphere_.step({0.0, 0.0, 0.01});
  const auto touch_W = sphere_.expected_touch({0.0, 0.0, 0.01}, {0.02, 0.0, -0.1}, 0.3);
  ASSERT_TRUE(touch_W);
  EXPECT_LT((*touch_W - Vector3d(0.002, 0.0, 0.0)).norm(), 2e-5);
  EXPECT_FALSE(sphere_.expected_touch({0.0, 0.0, 0.01}, {0.0, 0.0, -0.1}, 0.05));
  EXPECT_FALSE(sphere_.expected_touch({0.0, 0.0, 0.01}, {0.0, 0.0, 0.1}, 0.3));
  EXPECT_FALSE(sphere_.expected_touch({0.0, 0.0, 0.01}, Vector3d::Zero(), 0.3));
}

TEST_F(SlidingContactTest, APositionThatIsNotFiniteAnswersAsTheLastOneDid) {
  sphere_.step({0.0, 0.0, 0.005});
  const auto pressed = sphere_.step({0.0, 0.0, -0.001});
  const auto answer = sphere_.step({0.0, std::numeric_limits<double>::quiet_NaN(), 0.0});
  EXPECT_TRUE(answer.in_contact);
  EXPECT_FALSE(answer.equilibrium.converged);
  EXPECT_EQ(answer.equilibrium.force_W, pressed.equilibrium.force_W);
  EXPECT_EQ(answer.position_W, pressed.position_W);
}

TEST_F(SlidingContactTest, AGrasperClosesWhenPressedAndOpensWhenPulled) {
  SlidingContact grasper(mesh_, ToolShape::grasper(0.004, 0.03, 0.7),
                         {.press = {}, .grasp_N = 0.05, .let_go_N = 0.1});
  grasper.step({0.0, 0.0, 0.002});
  for (int step = 1; step <= 10 && grasper.step({0.0, 0.0, -0.001 * step}).epoch < 2; ++step) {
  }
  const auto deep = grasper.step({0.0, 0.0, -0.004});
  EXPECT_EQ(deep.epoch, 2U) << "one for the touch, one for the grasp";
  EXPECT_GT(grasper.pressed().held, 0);
  double most_pull_N = 0.0;
  ToolContact::Answer answer = deep;
  for (int step = 1; step <= 24 && answer.epoch == 2U; ++step) {
    answer = grasper.step({0.0, 0.0, -0.004 + 0.001 * step});
    most_pull_N = std::max(most_pull_N, -answer.equilibrium.force_W.z());
  }
  EXPECT_GE(most_pull_N, 0.1);
  EXPECT_EQ(answer.epoch, 3U);
  const auto free = grasper.step({0.0, 0.0, 0.025});
  EXPECT_FALSE(free.in_contact);
  EXPECT_EQ(free.equilibrium.force_W, Vector3d::Zero());
}

TEST(ToolContact, ASphereThatSticksTouchesWithItsTip) {
  const Scene scene = make_scene("small");
  const auto sphere = make_tool_contact(scene, {}, {.shape = "sphere", .contact = "sticky"});
  const auto point = make_tool_contact(scene, {}, {});
  for (const double z : {0.01, -0.0005, 0.004}) {
    const auto a = sphere->step({0.001, 0.002, z});
    const auto b = point->step({0.001, 0.002, z});
    EXPECT_EQ(a.in_contact, b.in_contact);
    EXPECT_EQ(a.equilibrium.force_W, b.equilibrium.force_W) << "on a flat surface";
  }
  EXPECT_TRUE(sphere->in_contact());
  EXPECT_TRUE(sphere->depends_on_position_alone());
  // Beside the block only the sphere reaches it.
  sphere->reset();
  point->reset();
  for (const double z : {0.01, -0.004}) {
    sphere->step({0.054, 0.0, z});
    point->step({0.054, 0.0, z});
  }
  EXPECT_TRUE(sphere->in_contact());
  EXPECT_FALSE(point->in_contact());
}

TEST(ToolContact, RefusesWhatDoesNotGoTogetherAndSaysWhatDoes) {
  const Scene scene = make_scene("small");
  const auto message = [&scene](const ToolOptions& options) -> std::string {
    try {
      make_tool_contact(scene, {}, options);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(message({.shape = "point", .contact = "slide"}), HasSubstr("give a sphere"));
  EXPECT_THAT(message({.shape = "grasper", .contact = "sticky"}), HasSubstr("give contact slide"));
  EXPECT_THAT(message({.shape = "spoon"}), HasSubstr("capsule"));
  EXPECT_THAT(message({.contact = "glue"}), HasSubstr("sticky or slide"));
  EXPECT_THAT(message({.shape = "sphere", .radius_m = 9.0}), HasSubstr("radius"));
  EXPECT_THAT(message({.shape = "grasper", .contact = "slide", .grasp_N = -1.0}),
              HasSubstr("closes"));
  EXPECT_THAT(message({.shape = "sphere", .contact = "slide", .friction = 9.0}),
              HasSubstr("friction"));
}

}  // namespace
}  // namespace forcegrid::simulator
