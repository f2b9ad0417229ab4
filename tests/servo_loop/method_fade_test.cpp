// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/method_fade.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "tests/servo_loop/loop_bench.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kDt_s = 0.002;
constexpr std::array<Triple, 3> kForces{{{0, 0, -1}, {0, 3, 2}, {1, 0, 0}}};

TEST(MethodFade, RendersTheFirstMethodToTheLastBitUntilAnotherIsChosen) {
  MethodFade fade;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::array<Triple, 2> forces{{{0.1, 0.2, 0.3}, {nan, nan, nan}}};
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(fade.force_W(kDt_s, 0, forces), Vector3d(0.1, 0.2, 0.3));
  }
}

TEST(MethodFade, TakesThreeTenthsOfASecondInEvenSteps) {
  MethodFade fade;
  const Vector3d step = Vector3d(0, 3, 3) * kDt_s / MethodFade::kFade_s;
  for (int i = 1; i <= 149; ++i) {
    EXPECT_LT((fade.force_W(kDt_s, 1, kForces) - (Vector3d(0, 0, -1) + i * step)).norm(), 1e-9);
  }
  fade.force_W(kDt_s, 1, kForces);
  EXPECT_EQ(fade.force_W(kDt_s, 1, kForces), Vector3d(0, 3, 2));
}

TEST(MethodFade, NeverStepsWhenTheChoiceChangesOnTheWay) {
  MethodFade fade;
  Vector3d last(0, 0, -1);
  // The methods' forces are at most 4.3 N apart.
  const double largest_step_N = 4.3 * kDt_s / MethodFade::kFade_s;
  for (int i = 0; i < 600; ++i) {
    const Vector3d now = fade.force_W(kDt_s, static_cast<std::size_t>(i / 37 % 3), kForces);
    EXPECT_LE((now - last).norm(), largest_step_N) << i;
    last = now;
  }
}

TEST(MethodFade, TakesAnIndexThatIsNoneForTheFirst) {
  MethodFade fade;
  for (int i = 0; i < 200; ++i) {
    fade.force_W(kDt_s, 7, kForces);
  }
  EXPECT_EQ(fade.force_W(kDt_s, 7, kForces), Vector3d(0, 0, -1));
}

// The loop: what the motors are told follows the choice, and the record names it.
TEST(RenderedMethod, IsTheOneThatWasChosen) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  SpokenMethod first, second;
  first.force_W = Vector3d(0, 0, -1);
  second.force_W = Vector3d(0, 0.5, -1);
  ServoPorts ports;
  ServoOptions options;
  options.check_motors = false;
  options.watch_encoders = false;
  ServoLoop loop(device, profile, {&first, &second}, ports, options);
  rt::TimePoint now(std::chrono::seconds(1000));
  CycleRecord record;
  const auto run = [&](int cycles) {
    for (int i = 0; i < cycles; ++i) {
      now += std::chrono::milliseconds(2);
      device.show(Vector3d::Zero(), now);
      if (i % 16 == 0) {
        ArrivedSample arrived;
        arrived.sample.force_W = first.force_W;
        arrived.sample.contact_epoch = 1;
        arrived.sample.time_s = servo_time_s(now);
        arrived.in_contact = true;
        arrived.arrived = now;
        ASSERT_TRUE(ports.samples.push(arrived));
      }
      ASSERT_EQ(loop.run_cycle(now, now + std::chrono::milliseconds(2)), Fault::kNone);
      while (ports.records.pop(record)) {
      }
    }
  };
  run(400);
  EXPECT_NEAR(record.commanded_force_D_N[1], 0.0, 1e-9);
  EXPECT_EQ(record.rendered_method, 0);
  ports.rendered_method = 1;
  run(75);  // half of the fade
  EXPECT_EQ(record.rendered_method, 1);
  EXPECT_NEAR(record.commanded_force_D_N[1], 0.25, 0.01);
  run(100);
  EXPECT_NEAR(record.commanded_force_D_N[1], 0.5, 1e-9);
  EXPECT_NEAR(record.commanded_force_D_N[2], -1.0, 1e-9);
}

// Requests and budget come from another thread; the record of the cycle says that they hold.
TEST(ServoLoop, TakesRequestsAndBudgetWhileItRuns) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  SpokenMethod method, other;
  ServoPorts ports;
  ServoOptions options;
  options.check_motors = false;
  options.watch_encoders = false;
  options.requests_per_s = 20.0;
  ServoLoop loop(device, profile, {&method, &other}, ports, options);
  rt::TimePoint now(std::chrono::seconds(1000));
  const auto cycle = [&] {
    now += std::chrono::milliseconds(2);
    device.show(Vector3d::Zero(), now);
    EXPECT_EQ(loop.run_cycle(now, now + std::chrono::milliseconds(2)), Fault::kNone);
    CycleRecord record;
    EXPECT_TRUE(ports.records.pop(record));
    return record;
  };
  CycleRecord record = cycle();
  EXPECT_EQ(record.requests_per_s, 20.0);
  EXPECT_TRUE(std::isnan(record.budget_reads));
  EXPECT_EQ(method.budgets, 0);
  ports.requests_per_s = 1e9;
  ports.budget_reads = 40.0;
  cycle();
  record = cycle();
  EXPECT_EQ(record.requests_per_s, options.rate_Hz) << "at most one a cycle";
  EXPECT_EQ(record.budget_reads, 40.0);
  EXPECT_EQ(method.budgets, 1) << "told once";
  EXPECT_EQ(other.budget_reads, 40.0);
  ports.requests_per_s = 0.0;
  ports.budget_reads = -1.0;  // no budget: ignored
  record = cycle();
  EXPECT_EQ(record.requests_per_s, 0.0);
  EXPECT_EQ(record.budget_reads, 40.0);
}

}  // namespace
}  // namespace forcegrid::servo
