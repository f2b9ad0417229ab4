// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/contact_prediction.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/predicted_contact.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/workers/query_solver.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using std::chrono_literals::operator""ms;

constexpr auto kPatience = std::chrono::seconds(30);
constexpr double kSame = 1e-9;  // the same computation again
const Vector3d kDown_W_m_per_s(0.0, 0.0, -0.05);
const Vector3d kAslant_W_m_per_s(0.02, -0.01, -0.05);

class ContactPredictionTest : public ::testing::TestWithParam<const char*> {
 protected:
  ToolOptions options(const char* shape) const { return {.shape = shape, .contact = "slide"}; }
  ContactPrediction contact_prediction(const char* shape, double friction = 0.3) const {
    return {scene_.mesh, *tool_shape(options(shape)), {.friction = friction}};
  }
  Vector3d touch_W(const char* shape, double x_m) const {
    const auto tool = make_tool_contact(scene_, {}, options(shape));
    return tool->expected_touch({x_m, 0.003, 0.01}, {0.0, 0.0, -0.1}, 0.3).value();
  }

  Scene scene_ = make_scene("small");
};

TEST_P(ContactPredictionTest, ForetellsWhatATouchingToolFeels) {
  const Vector3d there_W = touch_W(GetParam(), 0.011);
  const auto predicted = contact_prediction(GetParam()).press(there_W, kAslant_W_m_per_s);
  ASSERT_TRUE(predicted);
  EXPECT_EQ(predicted->touch_W, there_W);
  EXPECT_LT((predicted->course_W - Vector3d(0.4, -0.2, -1.0)).norm(), 1e-5);
  // The tool goes there, in steps as short as those of a servo.
  const auto tool = make_tool_contact(scene_, {}, options(GetParam()));
  tool->step(there_W + Vector3d(0.0, 0.0, 0.005));
  tool->step(there_W - 0.0005 * predicted->course_W);
  for (int step = 1; step <= 20; ++step) {
    const auto felt = tool->step(there_W + 1e-4 * step * predicted->course_W);
    if (step % 10 == 0) {
      const Vector3d& force_W = predicted->force_W[static_cast<std::size_t>(step / 10 - 1)];
      EXPECT_LT((force_W - felt.equilibrium.force_W).norm(), 0.05 * force_W.norm()) << step;
      EXPECT_GT(force_W.z(), 0.02);
      EXPECT_LT(force_W.x(), 0.0) << "friction against the way";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Tools, ContactPredictionTest,
                         ::testing::Values("sphere", "capsule", "grasper"));

TEST_F(ContactPredictionTest, GoesAlongTheSurfaceNoFartherThanTwiceItsDepth) {
  const ContactPrediction press = contact_prediction("sphere");
  const Vector3d there_W = touch_W("sphere", 0.0);
  const auto course = [&](const Vector3d& velocity_W) {
    return press.course_W(there_W, velocity_W).value();
  };
  EXPECT_LT((course(kDown_W_m_per_s) - Vector3d(0.0, 0.0, -1.0)).norm(), 1e-6);
  EXPECT_LT((course({0.0, 0.05, -0.05}) - Vector3d(0.0, 1.0, -1.0)).norm(), 1e-6);
  EXPECT_LT((course({0.5, 0.0, -0.05}) - Vector3d(2.0, 0.0, -1.0)).norm(), 1e-6);
  EXPECT_LT((course({0.5, 0.0, 0.1}) - Vector3d(2.0, 0.0, -1.0)).norm(), 1e-6);
  EXPECT_LT((course(Vector3d::Zero()) - Vector3d(0.0, 0.0, -1.0)).norm(), 1e-6);
}

TEST_F(ContactPredictionTest, KnowsNothingAwayFromTheSurfaceOrOfWhatIsNoNumber) {
  ContactPrediction press = contact_prediction("sphere");
  const Vector3d there_W = touch_W("sphere", 0.0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(press.press(there_W + Vector3d(0.0, 0.0, 0.001), kDown_W_m_per_s));
  EXPECT_FALSE(press.press({nan, 0.0, 0.0}, kDown_W_m_per_s));
  EXPECT_FALSE(press.press(there_W, {0.0, nan, -1.0}));
  EXPECT_TRUE(press.press(there_W, kDown_W_m_per_s));
}

TEST_F(ContactPredictionTest, PressesAnObjectAtRestWhateverWasPressedBefore) {
  ContactPrediction press = contact_prediction("sphere");
  const auto first = press.press(touch_W("sphere", 0.012), kAslant_W_m_per_s);
  ASSERT_TRUE(press.press(touch_W("sphere", 0.008), kAslant_W_m_per_s));
  const auto again = press.press(touch_W("sphere", 0.012), kAslant_W_m_per_s);
  ASSERT_TRUE(first && again);
  for (std::size_t k = 0; k < first->force_W.size(); ++k) {
    EXPECT_LT((first->force_W[k] - again->force_W[k]).norm(), kSame);
  }
}

TEST_F(ContactPredictionTest, WithoutFrictionThereIsNextToNoneAlongTheSurface) {
  const auto rough =
      contact_prediction("sphere", 0.3).press(touch_W("sphere", 0.0), {0.1, 0.0, -0.05});
  const auto smooth =
      contact_prediction("sphere", 0.0).press(touch_W("sphere", 0.0), {0.1, 0.0, -0.05});
  ASSERT_TRUE(rough && smooth);
  for (std::size_t k = 0; k < rough->force_W.size(); ++k) {
    // What a tool that sinks in aslant feels without friction is not quite upright.
    constexpr double kSlope = 0.12;
    EXPECT_LT(smooth->force_W[k].head<2>().norm(), kSlope * smooth->force_W[k].z());
    EXPECT_LT(rough->force_W[k].head<2>().norm(), (0.3 + kSlope) * rough->force_W[k].z());
    EXPECT_GT(-rough->force_W[k].x(), 0.2 * rough->force_W[k].z());
  }
}

/// Looks again and again until the patch says what is felt, or patience ends.
link::SurfacePatch patch_with_forces(PredictedContact& predicted, const ToolContact& contact,
                                     const Vector3d& position_W, const Vector3d& velocity_W) {
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  for (;;) {
    predicted.look(contact, position_W, velocity_W);
    link::SurfacePatch patch;
    patch.position_W_m = {position_W.x(), position_W.y(), position_W.z()};
    EXPECT_TRUE(predicted.cut(patch));
    if (patch.has_press_forces || std::chrono::steady_clock::now() > give_up) {
      return patch;
    }
    std::this_thread::sleep_for(1ms);
  }
}

Vector3d vector(const std::array<float, 3>& a) {
  return Eigen::Map<const Eigen::Vector3f>(a.data()).cast<double>();
}

TEST_F(ContactPredictionTest, APredictedContactOfASlidingToolStatesTheForcesOfTheNewestTouch) {
  PredictedContact predicted(scene_, options("sphere"));
  const auto contact = make_tool_contact(scene_, {}, options("sphere"));
  ContactPrediction press = contact_prediction("sphere");
  EXPECT_FALSE(predicted.wants_stiffness());
  for (const double x_m : {0.0, 0.02}) {
    // Touches 5 mm below, 2 mm farther on.
    const Vector3d from_W(x_m, 0.003, 0.005);
    const auto patch = patch_with_forces(predicted, *contact, from_W, {0.02, 0.0, -0.05});
    ASSERT_TRUE(patch.has_press_forces);
    EXPECT_FALSE(patch.has_stiffness);
    EXPECT_GT(patch.triangle_count, 0);
    EXPECT_FALSE(predicted.wants_stiffness()) << "which begins at zero";
    const auto expected = press.press(predicted.expected_W().value(), {0.02, 0.0, -0.05});
    ASSERT_TRUE(expected);
    for (std::size_t k = 0; k < expected->force_W.size(); ++k) {
      EXPECT_LT((vector(patch.press_forces_W_N[k]) - expected->force_W[k]).norm(), 1e-6);
    }
  }
  // 15 mm above, half a second before it touches.
  EXPECT_TRUE(patch_with_forces(predicted, *contact, {0.0, -0.01, 0.015}, {0.0, 0.0, -0.03})
                  .has_press_forces);
  EXPECT_FALSE(predicted.expected_W()) << "pressing begins earlier";
  // Another place, still being pressed or not: never the forces of one 2 cm away.
  predicted.look(*contact, {-0.02, 0.003, 0.005}, {0.02, 0.0, -0.05});
  link::SurfacePatch patch;
  EXPECT_TRUE(predicted.cut(patch));
  if (patch.has_press_forces) {
    const auto there = press.press(predicted.expected_W().value(), {0.02, 0.0, -0.05});
    ASSERT_TRUE(there);
    EXPECT_LT((vector(patch.press_forces_W_N[0]) - there->force_W[0]).norm(), 1e-6);
  }
  predicted.begin_anew();
  EXPECT_FALSE(predicted.expected_W());
}

TEST_F(ContactPredictionTest, APredictedContactOfAStickingToolAsksForItsStiffness) {
  PredictedContact predicted(scene_, {});
  const auto contact = make_tool_contact(scene_, {}, {});
  EXPECT_FALSE(predicted.wants_stiffness()) << "nothing is expected";
  predicted.look(*contact, {0.0, 0.003, 0.005}, kDown_W_m_per_s);
  ASSERT_TRUE(predicted.wants_stiffness());
  QuerySolver solver(scene_, {});
  predicted.learn_stiffness([&](const QueryJob& job) { return solver.answer(job); }, 3);
  EXPECT_FALSE(predicted.wants_stiffness());
  link::SurfacePatch patch;
  EXPECT_TRUE(predicted.cut(patch));
  EXPECT_TRUE(patch.has_stiffness);
  EXPECT_FALSE(patch.has_press_forces);
  EXPECT_LT(patch.stiffness_W_N_per_m[2], -10.0F);
}

TEST(ContactPredictionThread, CanEndWhileItPresses) {
  const Scene scene = make_scene("small");
  ContactPredictionThread thread(scene.mesh, contact::ToolShape::sphere(0.008), {});
  thread.expect({0.0, 0.003, 0.0}, kDown_W_m_per_s);
}

}  // namespace
}  // namespace forcegrid::simulator
