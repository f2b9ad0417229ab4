// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/degradation_ladder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "servo_loop/damping_field.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kCycle_s = 0.002;
constexpr double kPeriod_s = 1.0 / 30.0;
constexpr double kRounding = 1e-9;

class Ladder : public ::testing::Test {
 protected:
  void fresh(double seconds) {
    for (int i = 0; i < std::lround(seconds / kCycle_s); ++i) {
      ladder_.update(kCycle_s, 0.0, kPeriod_s, HeldBack::kNot);
    }
    age_s_ = 0.0;
  }
  // Samples have stopped.
  void starve(double seconds) {
    for (int i = 0; i < std::lround(seconds / kCycle_s); ++i) {
      ladder_.update(kCycle_s, age_s_ += kCycle_s, kPeriod_s, HeldBack::kNot);
    }
  }

  DegradationLadder ladder_{LadderOptions{}};
  double age_s_ = 0.0;
};

TEST_F(Ladder, BeginsAtZeroCurrentAndStaysThereWithoutASample) {
  EXPECT_EQ(ladder_.rung(), Rung::kZero);
  age_s_ = std::numeric_limits<double>::infinity();
  starve(5.0);
  EXPECT_EQ(ladder_.rung(), Rung::kZero);
  EXPECT_EQ(ladder_.held_back(), HeldBack::kNoSamples);
  EXPECT_EQ(ladder_.force_gain(), 0.0);
  EXPECT_EQ(ladder_.damping_gain(), 0.0);
}

TEST_F(Ladder, RampsInOnFreshSamples) {
  fresh(0.25);
  EXPECT_EQ(ladder_.rung(), Rung::kFresh);
  EXPECT_NEAR(ladder_.force_gain(), 0.5, kRounding);
  fresh(0.25);
  EXPECT_NEAR(ladder_.force_gain(), 1.0, kRounding);
}

TEST_F(Ladder, StepsDownRungByRungAtItsTimes) {
  fresh(1.0);
  starve(0.066);  // two periods are 66.7 ms
  EXPECT_EQ(ladder_.rung(), Rung::kFresh);
  starve(0.002);
  EXPECT_EQ(ladder_.rung(), Rung::kOld);
  starve(0.180);
  EXPECT_EQ(ladder_.rung(), Rung::kOld);  // 248 ms
  EXPECT_NEAR(ladder_.force_gain(), 1.0, kRounding);
  EXPECT_EQ(ladder_.damping_gain(), 0.0);
  starve(0.050);
  EXPECT_EQ(ladder_.rung(), Rung::kDamping);
  EXPECT_EQ(ladder_.held_back(), HeldBack::kNoSamples);
  EXPECT_NEAR(ladder_.force_gain(), 0.5, 0.03);
  EXPECT_NEAR(ladder_.damping_gain(), 1.0 - ladder_.force_gain(), kRounding);
  starve(1.900);  // 2.2 s: the end of the two seconds of damping is near
  EXPECT_EQ(ladder_.rung(), Rung::kDamping);
  EXPECT_EQ(ladder_.force_gain(), 0.0);
  EXPECT_NEAR(ladder_.damping_gain(), 1.0, kRounding);
  starve(0.160);  // 2.36 s: and it fades in 0.1 s
  EXPECT_EQ(ladder_.rung(), Rung::kZero);
  EXPECT_EQ(ladder_.damping_gain(), 0.0);
  fresh(0.002);
  EXPECT_EQ(ladder_.rung(), Rung::kFresh);
  EXPECT_NEAR(ladder_.force_gain(), kCycle_s / 0.5, kRounding);
}

TEST_F(Ladder, WaitsFivePeriodsForASlowSimulator) {
  ladder_.update(1.0, 0.0, 0.1, HeldBack::kNot);
  ladder_.update(kCycle_s, 0.2, 0.1, HeldBack::kNot);
  EXPECT_EQ(ladder_.rung(), Rung::kFresh);
  ladder_.update(kCycle_s, 0.499, 0.1, HeldBack::kNot);
  EXPECT_EQ(ladder_.rung(), Rung::kOld);
  ladder_.update(kCycle_s, 0.501, 0.1, HeldBack::kNot);
  EXPECT_EQ(ladder_.rung(), Rung::kDamping);
}

TEST_F(Ladder, GivesTheForceBackByTheRampWhileTheDampingGoes) {
  fresh(1.0);
  starve(1.0);
  fresh(0.1);
  EXPECT_NEAR(ladder_.force_gain(), 0.2, kRounding);
  EXPECT_NEAR(ladder_.damping_gain(), 0.0, kRounding);
}

TEST_F(Ladder, TakesTheForceAwayForWhateverHoldsItBack) {
  for (const HeldBack held_back : {HeldBack::kDeadMan, HeldBack::kMotorCheck}) {
    fresh(1.0);
    for (int i = 0; i < 55; ++i) {
      ladder_.update(kCycle_s, 0.0, kPeriod_s, held_back);
    }
    EXPECT_EQ(ladder_.rung(), Rung::kDamping);
    EXPECT_EQ(ladder_.held_back(), held_back);
    EXPECT_EQ(ladder_.force_gain(), 0.0);
  }
}

TEST_F(Ladder, DropsAtOnce) {
  fresh(1.0);
  starve(0.3);
  ladder_.drop();
  EXPECT_EQ(ladder_.rung(), Rung::kZero);
  EXPECT_EQ(ladder_.force_gain(), 0.0);
  EXPECT_EQ(ladder_.damping_gain(), 0.0);
  starve(0.002);
  EXPECT_EQ(ladder_.damping_gain(), 0.0);  // what has been dropped does not come back as damping
}

TEST_F(Ladder, RefusesTimesThatAreNone) {
  EXPECT_THROW(DegradationLadder({.ramp_in_s = 0.0}), std::invalid_argument);
  EXPECT_THROW(DegradationLadder({.fade_s = -1.0}), std::invalid_argument);
  EXPECT_THROW(DegradationLadder({.sample_timeout_s = std::nan("")}), std::invalid_argument);
  EXPECT_THROW(DegradationLadder({.damping_s = 0.0}), std::invalid_argument);
}

TEST(Rung, HasANameAndASentenceForEachReason) {
  EXPECT_STREQ(to_string(Rung::kFresh), "fresh sample");
  EXPECT_STREQ(to_string(Rung::kZero), "zero current");
  EXPECT_NE(sentence_for(Rung::kDamping, HeldBack::kNoSamples).find("no sample"),
            std::string::npos);
  EXPECT_NE(sentence_for(Rung::kZero, HeldBack::kDeadMan).find("dead-man"), std::string::npos);
  EXPECT_NE(sentence_for(Rung::kFresh, HeldBack::kNot).find("ramps in"), std::string::npos);
}

constexpr double kCount_m = 23e-6;

TEST(DampingField, OpposesTheMotionWithinItsBounds) {
  const DampingField field;
  const Vector3d resolution_W_m = Vector3d::Zero();
  const Vector3d slow_W(0.06, -0.08, 0.0);
  EXPECT_LT((field.force_W(slow_W, resolution_W_m) + 3.0 * slow_W).norm(), 1e-12);
  const Vector3d fast_W(0.0, 0.0, 2.0);
  EXPECT_LT((field.force_W(fast_W, resolution_W_m) - Vector3d(0.0, 0.0, -1.0)).norm(), 1e-12);
  EXPECT_EQ(field.force_W(Vector3d(0.0, std::nan(""), 0.0), resolution_W_m), Vector3d::Zero());
  EXPECT_EQ(field.force_W(Vector3d::Zero(), resolution_W_m), Vector3d::Zero());
}

TEST(DampingField, RefusesOptionsOutOfRange) {
  EXPECT_THROW(DampingField({.damping_N_s_per_m = -1.0}), std::invalid_argument);
  EXPECT_THROW(DampingField({.max_force_N = std::nan("")}), std::invalid_argument);
  EXPECT_THROW(DampingField({.velocity_time_constant_s = 0.0}), std::invalid_argument);
}

// The lightest arm, 46 g that nobody holds and without friction of its own, behind encoders of 23
// um: positions are read 1 ms late, forces held for a cycle.
TEST(DampingField, BringsALightArmToRestWithoutShakingIt) {
  const DampingField field;
  for (const double cycle_s : {0.001, 0.002}) {
    for (const double thrown_m_per_s : {0.001, 0.05, 0.5}) {
      constexpr double kMass_kg = 0.046;
      constexpr double kStep_s = 1e-4;
      double x_m = 0.4 * kCount_m;
      double v_m_per_s = thrown_m_per_s;
      double read_m = 0.0;
      double last_read_m = 0.0;
      double filtered_m_per_s = 0.0;
      double force_N = 0.0;
      double fastest_late_m_per_s = 0.0;
      const int steps = static_cast<int>(std::lround(cycle_s / kStep_s));
      for (int i = 0; i < 30000; ++i) {
        if (i % steps == steps - 10) {
          read_m = kCount_m * std::round(x_m / kCount_m);
        }
        if (i % steps == 0) {
          if (steps == 10) {
            read_m = kCount_m * std::round((x_m - 0.001 * v_m_per_s) / kCount_m);
          }
          const double share = 1.0 - std::exp(-cycle_s / 0.010);
          filtered_m_per_s += share * ((read_m - last_read_m) / cycle_s - filtered_m_per_s);
          last_read_m = read_m;
          force_N =
              field.force_W(Vector3d(filtered_m_per_s, 0.0, 0.0), Vector3d::Constant(kCount_m)).x();
        }
        v_m_per_s += kStep_s * force_N / kMass_kg;
        x_m += kStep_s * v_m_per_s;
        if (i > 20000) {
          fastest_late_m_per_s = std::max(fastest_late_m_per_s, std::abs(v_m_per_s));
        }
      }
      // What is left is the dead band: less than a count in 10 ms.
      EXPECT_LE(fastest_late_m_per_s, std::max(kCount_m / 0.010, 0.0)) << thrown_m_per_s;
    }
  }
}

}  // namespace
}  // namespace forcegrid::servo
