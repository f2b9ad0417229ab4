// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/dynamic_contact.h"

#include <gtest/gtest.h>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "tests/simulator/little_jelly.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

class DynamicContact : public ::testing::Test {
 protected:
  static constexpr double kTick_s = 1.0 / 30.0;

  std::unique_ptr<ToolContact> touched(const ToolOptions& options = {}) {
    auto contact = make_dynamic_contact(scene_, {}, options);
    time_s_ = 100.0;
    step(*contact, {0, 0, 0.01}, kTick_s);
    EXPECT_TRUE(step(*contact, {0, 0, -0.0005}, kTick_s).in_contact);
    return contact;
  }

  ToolContact::Answer step(ToolContact& contact, const Vector3d& position_W, double after_s) {
    time_s_ += after_s;
    contact.tell_time(time_s_);
    return contact.step(position_W);
  }

  Scene scene_ = testing::little_jelly();
  double time_s_ = 0.0;
};

TEST_F(DynamicContact, TheForceBeginsWithZeroAndDependsOnHowFastTheToolWent) {
  double force_N[2] = {};
  for (const int slow : {0, 1}) {
    const auto contact = touched();
    EXPECT_EQ(contact->in_contact(), true);
    const auto answer = step(*contact, {0, 0, 0.0055}, slow == 0 ? 0.02 : 2.0);
    EXPECT_EQ(answer.epoch, 1U);
    EXPECT_NEAR(answer.point_W.z(), 0.0, 1e-3) << "the way down is 10.5 mm long, in 17 moves";
    EXPECT_TRUE(answer.equilibrium.converged);
    EXPECT_FALSE(answer.stiffness_known);
    force_N[slow] = answer.equilibrium.force_W.z();
  }
  // Against the pull, and more so with inertia and dampers.
  EXPECT_LT(force_N[1], -0.2);
  EXPECT_LT(force_N[0], 1.3 * force_N[1]);
  EXPECT_FALSE(touched()->depends_on_position_alone());
}

TEST_F(DynamicContact, WithoutTimeNothingMovesAndTimeThatGoesBackIsNone) {
  const auto contact = touched();
  const auto before = step(*contact, {0, 0, 0.002}, kTick_s);
  const auto again = step(*contact, {0, 0, 0.002}, 0.0);
  EXPECT_EQ(again.equilibrium.force_W, before.equilibrium.force_W);
  const auto back = step(*contact, {0, 0, 0.004}, -1.0);
  EXPECT_EQ(back.equilibrium.force_W, before.equilibrium.force_W);
  EXPECT_FALSE(back.equilibrium.converged);
  EXPECT_EQ(back.position_W, Vector3d(0, 0, 0.002)) << "where the force belongs";
}

TEST_F(DynamicContact, APauseIsLivedThroughInLongStepsAndANewRunBeginsAtRest) {
  const auto contact = touched();
  step(*contact, {0, 0, 0.003}, kTick_s);
  EXPECT_EQ(contact->report().long_step, false);
  const auto late = step(*contact, {0, 0, 0.004}, 5.0);
  EXPECT_TRUE(late.equilibrium.converged);
  EXPECT_EQ(contact->report().long_step, true);
  contact->reset();
  EXPECT_FALSE(contact->in_contact());
  const auto air = step(*contact, {0, 0, 0.02}, 50.0);
  EXPECT_FALSE(air.in_contact);
  EXPECT_EQ(air.epoch, 0U);
  step(*contact, {0, 0, -0.0002}, kTick_s);
  EXPECT_LT(step(*contact, {0, 0, -0.0002}, kTick_s).equilibrium.force_W.norm(), 1e-9);
}

TEST_F(DynamicContact, ASphereSticksAndWhatSlidesIsRefused) {
  const auto sphere = make_dynamic_contact(scene_, {}, {.shape = "sphere"});
  step(*sphere, {0, 0, 0.03}, kTick_s);
  EXPECT_TRUE(step(*sphere, {0, 0, 0.0}, kTick_s).in_contact);
  EXPECT_THROW(make_dynamic_contact(scene_, {}, {.shape = "sphere", .contact = "slide"}), Error);
  EXPECT_THROW(make_dynamic_contact(make_scene("small"), {}, {}), Error) << "no masses";
}

}  // namespace
}  // namespace forcegrid::simulator
