// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/contact_prediction.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <string>
#include <thread>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/predicted_contact.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/workers/query_solver.h"
#include "tests/simulator/dense_newton.h"
#include "tests/simulator/element_block.h"

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

// A block of elements that a tool can touch from above.
Scene element_scene(ElementModel model) {
  constexpr std::array<int, 3> kCells{4, 4, 3};
  Scene scene;
  scene.name = "elements";
  scene.mesh = element_block(kCells, 0.01, soft(model, 0.4), 0.15);
  const auto top = [&](int x, int y) { return x + (kCells[0] + 1) * (y + (kCells[1] + 1) * 3); };
  for (int y = 0; y < kCells[1]; ++y) {
    for (int x = 0; x < kCells[0]; ++x) {
      scene.mesh.triangles.push_back({top(x, y), top(x + 1, y), top(x + 1, y + 1)});
      scene.mesh.triangles.push_back({top(x, y), top(x + 1, y + 1), top(x, y + 1)});
    }
  }
  return scene;
}

class ContactPredictionOfElements : public ::testing::TestWithParam<ElementModel> {
 protected:
  Scene scene_ = element_scene(GetParam());
};

TEST_P(ContactPredictionOfElements, PredictsTheForcesThatAnIndependentSolveFindsThere) {
  PredictedContact predicted(scene_, {});
  const auto contact = make_tool_contact(scene_, {}, {});
  QuerySolver solver(scene_, {});
  // In the middle, and where the patch is at the block's side.
  for (const Vector3d& from_W : {Vector3d(0.001, 0.002, 0.005), Vector3d(0.014, -0.009, 0.005)}) {
    predicted.look(*contact, from_W, kAslant_W_m_per_s);
    ASSERT_TRUE(predicted.wants_stiffness());
    predicted.learn_stiffness([&](const QueryJob& job) { return solver.answer(job); }, 1);
    link::SurfacePatch patch;
    patch.position_W_m = {from_W.x(), from_W.y(), from_W.z()};
    ASSERT_TRUE(predicted.cut(patch));
    EXPECT_GT(patch.triangle_count, 0);
    ASSERT_TRUE(patch.has_stiffness);
    const auto& k = patch.stiffness_W_N_per_m;
    Eigen::Matrix3d stiffness_W;
    stiffness_W << k[0], k[3], k[4], k[3], k[1], k[5], k[4], k[5], k[2];
    DenseNewton newton(scene_.mesh, predicted.expected_W().value(), scene_.patch_radius_m);
    ASSERT_FALSE(newton.held.empty());
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d by_W = 1e-5 * Vector3d::Unit(axis);
      const Vector3d slope_W = (newton.force_at(by_W, 1) - newton.force_at(-by_W, 1)) / 2e-5;
      EXPECT_LT((stiffness_W.col(axis) - slope_W).norm(), 5e-3 * stiffness_W.norm()) << axis;
    }
    const Vector3d pressed_W(2e-4, -1e-4, -4e-4);
    const Vector3d force_W = newton.force_at(pressed_W, 1);
    EXPECT_GT(force_W.z(), 0.005);
    EXPECT_LT((stiffness_W * pressed_W - force_W).norm(), 0.05 * force_W.norm());
    // The tool that then touches there feels it, too.
    const auto tool = make_tool_contact(scene_, {}, {});
    tool->step(from_W);
    ASSERT_TRUE(tool->step(*predicted.expected_W() - Vector3d(0.0, 0.0, 1e-9)).in_contact);
    const auto felt = tool->step(*predicted.expected_W() + pressed_W);
    EXPECT_LT((felt.equilibrium.force_W - force_W).norm(), 2e-3 * force_W.norm());
  }
}

INSTANTIATE_TEST_SUITE_P(Materials, ContactPredictionOfElements,
                         ::testing::ValuesIn(kElementModels));

TEST(PredictedContactOfElements, ASlidingToolIsRefused) {
  const Scene scene = element_scene(ElementModel::kNeoHookean);
  try {
    PredictedContact predicted(scene, {.shape = "sphere", .contact = "slide"});
    FAIL() << "it predicts for elements as if they were springs";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("a tool that slides: "), std::string::npos)
        << error.what();
  }
}

TEST(ContactPredictionThread, CanEndWhileItPresses) {
  const Scene scene = make_scene("small");
  ContactPredictionThread thread(scene.mesh, contact::ToolShape::sphere(0.008), {});
  thread.expect({0.0, 0.003, 0.0}, kDown_W_m_per_s);
}

}  // namespace
}  // namespace forcegrid::simulator
