// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/motor_warmth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "rt/vectors.h"
#include "tests/servo_loop/loop_bench.h"

namespace forcegrid::servo {
namespace {

constexpr double kCycle_s = 0.01;

class WarmMotors : public ::testing::Test {
 protected:
  // Axis b wants `wanted_A` for `seconds` and gets what it may. @returns what it gets at last.
  double push(double wanted_A, double seconds) {
    double current_A = 0.0;
    for (int i = 0; i < std::lround(seconds / kCycle_s); ++i) {
      current_A = wanted_A * warmth_.scale({0.0, wanted_A, 0.0});
      warmth_.advance(kCycle_s, {0.0, current_A, 0.0});
    }
    return current_A;
  }

  profiles::DeviceProfile profile_ = profiles::load_device_profile("phantom_desktop");
  MotorWarmth warmth_{profile_};
};

TEST_F(WarmMotors, BearTheContinuousCurrentForEver) {
  EXPECT_NEAR(push(1.24, 600.0), 1.24, 1e-9);
  EXPECT_NEAR(warmth_.warmest(), 1.0, 1e-6);
}

TEST_F(WarmMotors, GetThePeakCurrentUntilTheyAreWarmAndThenSettleAtTheContinuousOne) {
  // theta = I_p^2 (1 - exp(-t / tau)) reaches 0.8 I_c^2 after this time.
  const double until_s = -12.0 * std::log(1.0 - 0.8 * std::pow(1.24 / 5.0, 2));
  EXPECT_EQ(push(5.0, until_s - 2.0 * kCycle_s), 5.0);
  EXPECT_LT(push(5.0, 4.0 * kCycle_s), 5.0);
  EXPECT_TRUE(warmth_.limits());
  EXPECT_NEAR(push(5.0, 300.0), 1.24, 1e-3);
  EXPECT_LE(warmth_.warmest(), 1.0 + 1e-9);
}

TEST_F(WarmMotors, CoolWithTheirTimeConstant) {
  push(1.24, 600.0);
  push(0.0, 12.0);
  EXPECT_NEAR(warmth_.warmest(), std::exp(-1.0), 1e-6);
  EXPECT_EQ(warmth_.scale({0.0, 5.0, 0.0}), 1.0);
}

TEST_F(WarmMotors, DoNotCountWhatIsNotANumber) {
  warmth_.advance(1.0, {std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0});
  warmth_.advance(std::numeric_limits<double>::infinity(), {5.0, 5.0, 5.0});
  warmth_.advance(-1.0, {5.0, 5.0, 5.0});
  EXPECT_EQ(warmth_.warmest(), 0.0);
}

TEST_F(WarmMotors, OfADeltaAreNotKnown) {
  MotorWarmth delta(profiles::load_device_profile("falcon"));
  delta.advance(100.0, {5.0, 5.0, 5.0});
  EXPECT_EQ(delta.warmest(), 0.0);
  EXPECT_EQ(delta.scale({5.0, 5.0, 5.0}), 1.0);
}

class LoopWithMotors : public LoopBench {
 protected:
  LoopWithMotors() : LoopBench(observing()) {}

  // The guard shortens a force that nobody has pressed out of an object.
  static ServoOptions observing() {
    ServoOptions changed = options();
    changed.rendering.passivity.mode = PassivityMode::kObserve;
    return changed;
  }
};

TEST_F(LoopWithMotors, LeadsTheirCurrentToTheContinuousOneInTheDirectionOfTheForce) {
  method_.force_W = Eigen::Vector3d(0.0, 0.0, -4.5);
  double largest_A = 0.0;
  Eigen::Vector3d cold_A = Eigen::Vector3d::Zero();
  CycleRecord last;
  for (int i = 0; i < 60000; ++i) {  // two minutes
    ASSERT_EQ(cycle(), Fault::kNone);
    if (i % 100 == 99) {
      last = record();
      largest_A = std::max(largest_A, rt::to_vector(last.current_A).cwiseAbs().maxCoeff());
      cold_A = i == 199 ? rt::to_vector(last.current_A) : cold_A;
    }
  }
  ASSERT_GT(largest_A, 2.0);  // more than 1.2 A while cold
  EXPECT_NEAR(rt::to_vector(last.current_A).cwiseAbs().maxCoeff(), 1.2, 0.01);
  EXPECT_NE(last.limits_acted & driver::kLimitWarm, 0);
  EXPECT_GT(last.motor_warmth, 0.95);
  EXPECT_LT((rt::to_vector(last.current_A).normalized() - cold_A.normalized()).norm(), 1e-6);
}

}  // namespace
}  // namespace forcegrid::servo
