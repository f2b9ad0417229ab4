// SPDX-License-Identifier: Apache-2.0
// The loop with a surface of its own, in scripted time.

#include "servo_loop/first_touch.h"
#include "tests/servo_loop/loop_bench.h"
#include "tests/servo_loop/square_patch.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kStiffness_N_per_m = 500.0;

class FirstTouchLoop : public LoopBench {
 protected:
  void show_surface() {
    const auto surface =
        near_surface(square_patch(now_.time_since_epoch().count(), 0.0, kStiffness_N_per_m));
    ASSERT_TRUE(surface);
    ports_.surface.publish(*surface);
  }

  /// In the air for so long that the force has ramped in, then down by 0.2 mm a cycle.
  void come_down_to(double height_m, bool with_surface) {
    constexpr int kRamped = 100;
    for (int i = 0; i < kRamped; ++i) {
      if (i % kCyclesPerSample == 0) {
        arrive(Vector3d::Zero(), false, 0);
        if (with_surface) {
          show_surface();
        }
      }
      cycle(Vector3d(0.003, 0.0, 0.003), false);
    }
    for (double z_m = 0.003; z_m > height_m; z_m -= 0.0002) {
      cycle(Vector3d(0.003, 0.0, z_m), false);
    }
  }
};

TEST_F(FirstTouchLoop, FeelsASurfaceBeforeTheSimulatorHasAnswered) {
  come_down_to(-0.0011, true);
  const CycleRecord felt = record();
  EXPECT_FALSE(felt.in_contact) << "the simulator knows nothing yet";
  const double depth_m = -felt.position_W_m[2];
  EXPECT_GT(depth_m, 0.0008);
  EXPECT_EQ(felt.method_force_W_N[0], Triple{}) << "nor does the method";
  // What the encoder can't tell, and what the slew limit and the guard take of a growing force.
  EXPECT_NEAR(felt.commanded_force_D_N[2], kStiffness_N_per_m * depth_m, 0.05);
}

TEST_F(FirstTouchLoop, WithoutASurfaceNothingIsFeltBeforeTheAnswer) {
  come_down_to(-0.0011, false);
  EXPECT_EQ(record().commanded_force_D_N, Triple{});
}

TEST_F(FirstTouchLoop, IsCountedInTheOutcome) {
  come_down_to(-0.0011, true);
  arrive(Vector3d(0.0, 0.0, 0.5), true, 1);
  cycle(Vector3d(0.003, 0.0, -0.0011), false);
  const std::atomic<bool> stop{true};
  const ServoOutcome outcome = loop_.run(stop, 0.0);
  EXPECT_GT(outcome.first_touches.patches, 0U);
  EXPECT_EQ(outcome.first_touches.touches, 1U);
  EXPECT_EQ(outcome.first_touches.answered, 1U);
}

}  // namespace
}  // namespace forcegrid::servo
