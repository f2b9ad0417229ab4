// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rt/vectors.h"
#include "tests/servo_loop/loop_bench.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kJoule = 1e-9;  // rounding, of sums of some hundred products of 1e-4 J

class LoopPassivity : public LoopBench {
 protected:
  using LoopBench::LoopBench;

  // Where the loop believes the tool to be after it was shown `wanted_D`: on whole counts.
  Vector3d read_W() const { return rt::to_vector(last_.position_W_m); }

  Fault step(const Vector3d& position_D, bool with_samples = true) {
    const Fault fault = cycle(position_D, with_samples);
    last_ = record();
    return fault;
  }

  CycleRecord last_;
};

class ObservingLoop : public LoopPassivity {
 protected:
  static ServoOptions observing() {
    ServoOptions options = LoopBench::options();
    options.rendering.passivity.mode = PassivityMode::kObserve;
    return options;
  }
  ObservingLoop() : LoopPassivity(observing()) {}
};

TEST_F(ObservingLoop, CountsTheWorkOfTheForceThatLeftItRampAndFadeIncluded) {
  method_.force_W = Vector3d(0.0, 1.5, -0.5);
  double work_J = 0.0;
  double most_work_J = 0.0;
  Vector3d force_W = Vector3d::Zero();
  Vector3d before_W = Vector3d::Zero();
  bool ramped = false;
  bool faded = false;
  for (int i = 0; i < 500; ++i) {
    // Samples stop in the middle; from 0.25 s on the force fades.
    ASSERT_EQ(step(Vector3d(0.0, 0.02 * std::sin(0.02 * i), 0.0), i < 250), Fault::kNone);
    work_J += i == 0 ? 0.0 : force_W.dot(read_W() - before_W);
    most_work_J = std::max(most_work_J, std::abs(work_J));
    force_W = rt::to_vector(last_.commanded_force_D_N);
    before_W = read_W();
    ramped = ramped || (i < 250 && last_.gain > 0.4 && last_.gain < 0.6);
    faded = faded || (i > 250 && last_.gain > 0.4 && last_.gain < 0.6);
    // The rounding of counts changes the sum where the force changes, by less than half a count a
    // newton: 0.1 mm * 1.6 N.
    ASSERT_NEAR(last_.energy_to_hand_J, work_J, 0.05e-3) << i;
  }
  EXPECT_TRUE(ramped && faded);
  EXPECT_GT(most_work_J, 1e-2);
}

TEST_F(LoopPassivity, CountsNoWorkOfTheTorqueThatCarriesTheLinks) {
  ServoOptions carrying = options();
  carrying.gravity_compensation = true;
  ServoPorts ports;
  ServoLoop loop(device_, profile_, {&method_}, ports, carrying);
  CycleRecord last;
  for (int i = 0; i < 500; ++i) {
    now_ += kPeriod;
    device_.show(Vector3d(0.0, 0.0, 0.03 * std::sin(0.02 * i)), now_);
    ASSERT_EQ(loop.run_cycle(now_, now_ + kPeriod), Fault::kNone);
    while (ports.records.pop(last)) {
    }
    ASSERT_EQ(last.energy_to_hand_J, 0.0);
  }
  EXPECT_FALSE(is_zero(device_.commands.back()));
}

TEST_F(LoopPassivity, DampsAForceThatKeepsGivingEnergyAndThenShortensIt) {
  // Always 1 N along the motion, to and fro: a motor and no object.
  Vector3d position_D = Vector3d::Zero();
  method_.force_W = Vector3d(0.0, 1.0, 0.0);
  for (int i = 0; i < 60; ++i) {
    ASSERT_EQ(step(position_D), Fault::kNone);  // the ramp
  }
  bool damped = false;
  double shortest = 1.0;
  for (int i = 0; i < 1000; ++i) {
    const double speed_m_per_s = 0.05 * std::sin(2.0 * std::numbers::pi * 0.002 * i);
    position_D.y() += 0.002 * speed_m_per_s;
    method_.force_W = Vector3d(0.0, std::copysign(1.0, speed_m_per_s), 0.0);
    ASSERT_EQ(step(position_D), Fault::kNone);
    damped = damped || last_.passivity_damping_N_s_per_m > 0.0;
    shortest = std::min(shortest, last_.passivity_scale);
    EXPECT_LT(last_.energy_to_hand_J, 1e-3) << i;
    EXPECT_LE(last_.passivity_damping_N_s_per_m, profile_.limits.max_damping_N_s_per_m);
  }
  EXPECT_TRUE(damped);
  EXPECT_LT(shortest, 0.2);
}

TEST_F(LoopPassivity, LetsAForceRampInThatPushesTheHandOut) {
  // 1 N comes in 0.1 s and pushes the tool 3 mm away: 2 mJ, and 60 mW at the end.
  method_.force_W = Vector3d(0.0, 1.0, 0.0);
  for (int i = 0; i < 60; ++i) {
    const double gone = std::min(1.0, i / 50.0);
    ASSERT_EQ(step(Vector3d(0.0, 0.003 * gone * gone, 0.0)), Fault::kNone);
    EXPECT_EQ(last_.passivity_scale, 1.0) << i;
  }
  EXPECT_EQ(last_.gain, 1.0);
  EXPECT_GT(last_.energy_to_hand_J, 1.8e-3);
}

TEST_F(LoopPassivity, OpensANewAccountATenthOfASecondAfterTheContact) {
  method_.force_W = Vector3d(0.0, -1.0, 0.0);
  double y_m = 0.0;
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(step(Vector3d(0.0, y_m += 0.0002, 0.0)), Fault::kNone);
  }
  ASSERT_LT(last_.energy_to_hand_J, -5e-3);
  method_.force_W.setZero();
  arrive(Vector3d::Zero(), false);
  const double left_J = [&] {
    EXPECT_EQ(step(Vector3d(0.0, y_m, 0.0), false), Fault::kNone);
    return last_.energy_to_hand_J;
  }();
  for (int i = 0; i < 48; ++i) {
    ASSERT_EQ(step(Vector3d(0.0, y_m, 0.0), false), Fault::kNone);
    ASSERT_NEAR(last_.energy_to_hand_J, left_J, kJoule);
  }
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(step(Vector3d(0.0, y_m, 0.0), false), Fault::kNone);
  }
  EXPECT_EQ(last_.energy_to_hand_J, 0.0);
}

class CoupledLoop : public LoopPassivity {
 protected:
  static ServoOptions coupled() {
    ServoOptions options = LoopBench::options();
    options.rendering.coupling =
        CouplingOptions{.stiffness_N_per_m = 500.0, .damping_N_s_per_m = 5.0};
    return options;
  }
  CoupledLoop() : LoopPassivity(coupled()) {}
};

TEST_F(CoupledLoop, TouchesTheObjectWhereItsSpringLetsTheProxyBe) {
  method_.force_W = Vector3d(0.0, 0.0, 1.0);
  for (int i = 0; i < 200; ++i) {
    ASSERT_EQ(step(Vector3d::Zero()), Fault::kNone);
  }
  // 1 N on 500 N/m: the proxy is 2 mm away, methods and simulator are asked there.
  EXPECT_NEAR(last_.touching_W_m[2] - last_.position_W_m[2], 0.002, 1e-9);
  link::ToolState tool;
  ASSERT_TRUE(ports_.tool.fetch(tool));
  EXPECT_EQ(tool.position_W_m, last_.touching_W_m);
}

}  // namespace
}  // namespace forcegrid::servo
