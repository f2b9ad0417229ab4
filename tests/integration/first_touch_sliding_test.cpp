// SPDX-License-Identifier: Apache-2.0
// What the hand feels in the first 67 ms after a tool that slides has touched, with and without
// what the simulator has pressed ahead.

#include <iostream>
#include <string>

#include "simulator/mesh/scene.h"
#include "simulator/touch/contact_prediction.h"
#include "tests/integration/first_touch_bench.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr std::array kPlaces_m = {-0.02, 0.0, 0.02};

class SlidingTouch : public ::testing::Test {
 protected:
  /// The tick comes so many cycles after the touch.
  static int phase(std::size_t place) { return 4 + 5 * static_cast<int>(place); }

  /// The tool's position where it touches when it comes down there.
  Vector3d touch_W(double x_m) const {
    const Vector3d place_W = scene_.mesh.top_W + Vector3d(x_m, 0.5 * x_m + 0.003, 0.0);
    const auto tool = simulator::make_tool_contact(scene_, {}, options_);
    return tool->expected_touch(place_W + Vector3d(0.0, 0.0, 0.01), {0.0, 0.0, -0.1}, 0.3).value();
  }

  /// @param beside_m  what is felt was pressed so far from where the tool touches.
  TouchErrors touch_at(std::size_t place, const Approach& approach, double beside_m = 0.0) {
    const auto tool = simulator::make_tool_contact(scene_, {}, options_);
    const auto reference = simulator::make_tool_contact(scene_, {}, options_);
    auto surface = simulator::LocalSurface::make(scene_.mesh, options_).value();
    simulator::ContactPrediction contact_prediction(scene_.mesh, *simulator::tool_shape(options_),
                                                    {.friction = options_.friction});
    FirstTouchBench bench{*tool, *reference, surface, [&](const Vector3d& expected_W, auto& patch) {
                            const auto pressed =
                                contact_prediction.press(expected_W + Vector3d(0.0, beside_m, 0.0),
                                                         approach.velocity_W_m_per_s);
                            ASSERT_TRUE(pressed);
                            patch.has_press_forces = true;
                            for (std::size_t k = 0; k < pressed->force_W.size(); ++k) {
                              Eigen::Map<Eigen::Vector3f>(patch.press_forces_W_N[k].data()) =
                                  pressed->force_W[k].cast<float>();
                            }
                          }};
    const TouchErrors errors = bench.touch_at(touch_W(kPlaces_m[place]), approach, phase(place));
    EXPECT_EQ(errors.cycles_to_force, 0) << "felt in the cycle that is inside first";
    EXPECT_GE(errors.cycles_to_force_without, FirstTouchBench::kLatencyCycles);
    std::cout << options_.shape << " at " << kPlaces_m[place] << " m: " << errors.with_percent
              << " % with, " << errors.without_percent << " % without; "
              << errors.unanswered_percent << " % in the " << errors.unanswered_cycles
              << " cycles until the answer; first force without after "
              << errors.cycles_to_force_without << " cycles\n";
    return errors;
  }

  simulator::Scene scene_ = simulator::make_scene("small");
  simulator::ToolOptions options_{.shape = "sphere", .contact = "slide"};
};

class SlidingTool : public SlidingTouch, public ::testing::WithParamInterface<const char*> {};

// A capsule stands on its round end, and feels what a sphere feels.
TEST_P(SlidingTool, FeelsWhatItWillFeelUntilTheSimulatorAnswers) {
  options_.shape = GetParam();
  double with = 0.0;
  double without = 0.0;
  for (std::size_t place = 0; place < kPlaces_m.size(); ++place) {
    const TouchErrors errors = touch_at(place, {});
    EXPECT_LT(errors.unanswered_percent, 6.0);
    EXPECT_LT(errors.with_percent, 0.75 * errors.without_percent);
    with += errors.with_percent;
    without += errors.without_percent;
  }
  EXPECT_LT(with, 0.4 * without) << "on average";
}

INSTANTIATE_TEST_SUITE_P(Tools, SlidingTool, ::testing::Values("sphere", "grasper"));

TEST_F(SlidingTouch, WhatWasPressed5MmAsideIsStillNearlyRight) {
  const TouchErrors errors = touch_at(2, {}, simulator::ContactPredictionThread::kUsable_m);
  EXPECT_LT(errors.unanswered_percent, 20.0);
}

// Friction is predicted for a tool that keeps its direction, not for a hand that turns. The error
// stays far below that of no force at all, 100 %.
TEST_F(SlidingTouch, OfAHandThatTurnsFrictionIsWrongAndThePushIsRight) {
  const Vector3d steep_W(0.01, 0.0, -0.05);
  const Vector3d slanting_W(0.05, 0.0, -0.05);
  for (const auto& [approach, most_percent] :
       {std::pair{Approach{steep_W, Vector3d::Zero()}, 20.0},
        std::pair{Approach{steep_W, {0.0, 0.02, 0.0}}, 35.0},
        std::pair{Approach{slanting_W, {0.05, 0.0, 0.0}}, 20.0},
        std::pair{Approach{slanting_W, {-0.05, 0.0, 0.0}}, 60.0}}) {
    const TouchErrors errors = touch_at(2, approach);
    EXPECT_LT(errors.unanswered_percent, most_percent);
    EXPECT_LT(errors.with_percent, errors.without_percent);
  }
}

}  // namespace
}  // namespace forcegrid::servo
