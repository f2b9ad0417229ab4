// SPDX-License-Identifier: Apache-2.0
#include "stability/closed_loop.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include "forcegrid/methods.h"
#include "stability/search.h"
#include "stability/theory.h"

namespace forcegrid::stability {
namespace {

constexpr double kAgreement = 0.10;  // of the eigenvalue limit, what the model is held to

// No friction, no quantisation, no limit of the motors.
LoopSetup linear_setup(const std::string& hand, double servo_rate_Hz, const std::string& timing) {
  LoopSetup setup;
  setup.servo_rate_Hz = servo_rate_Hz;
  setup.timing = device_timing(timing);
  setup.device.position_step_m = 0.0;
  setup.device.max_force_N = std::numeric_limits<double>::infinity();
  setup.hand = hand_of(hand);
  // So long that what decays at all has decayed: just below its boundary an oscillation loses
  // hardly anything, and a heavy or free tool takes longest.
  setup.hold_s = 60.0;
  return setup;
}

LoopResult run(const LoopSetup& setup, double stiffness_N_per_m, const std::string& method) {
  LinearObject object(stiffness_N_per_m, setup.contact_point_W);
  if (method == "exact") {
    return run_closed_loop(setup, object, nullptr);
  }
  MethodOptions options;
  options.grid.max_W = {0.16, 0.12, 0.12};
  options.grid.cells.setConstant(49);
  const auto made = make_force_method(method, options);
  return run_closed_loop(setup, object, made.get());
}

double limit_N_per_m(const LoopSetup& setup, const std::string& method) {
  return find_limit([&](double stiffness_N_per_m) {
           return run(setup, stiffness_N_per_m, method).behaviour;
         })
      .largest_stable_N_per_m;
}

TEST(ClosedLoop, ExactForceIsStableUpToTheEigenvalueLimit) {
  int compared = 0;
  for (const char* hand : {"none", "light", "firm"}) {
    for (const auto& [rate_Hz, timing] :
         std::vector<std::pair<double, const char*>>{{500.0, "ideal"},
                                                     {500.0, "w2_full_speed"},
                                                     {500.0, "on_board"},
                                                     {1000.0, "w2_full_speed"}}) {
      const LoopSetup setup = linear_setup(hand, rate_Hz, timing);
      const double expected = eigenvalue_limit_N_per_m(
          sampled_spring(setup.device, setup.hand, 1.0 / rate_Hz,
                         setup.timing.count_age_s + setup.timing.actuation_delay_s));
      if (expected > 0.9 * StiffnessScan::kMost_N_per_m) {
        continue;  // not to be found by the scan
      }
      ++compared;
      EXPECT_NEAR(limit_N_per_m(setup, "exact"), expected, kAgreement * expected)
          << hand << ' ' << rate_Hz << " Hz " << timing;
    }
  }
  EXPECT_GE(compared, 7);
}

TEST(ClosedLoop, WhatStillDecaysAfterTheStatedRestIsStable) {
  // A bare device loses an oscillation with 2 m / (b (1 - K / K_0)), 8 s at 0.95 of its limit.
  LoopSetup setup = linear_setup("none", 500.0, "ideal");
  setup.hold_s = 4.0;
  const double expected =
      eigenvalue_limit_N_per_m(sampled_spring(setup.device, setup.hand, 0.002, 0.0));
  EXPECT_EQ(run(setup, 0.95 * expected, "exact").behaviour, Behaviour::kLimitCycle);
  setup.longest_settling_s = 16.0;
  const LoopResult below = run(setup, 0.95 * expected, "exact");
  EXPECT_EQ(below.behaviour, Behaviour::kStable);
  EXPECT_LT(below.hold_peak_to_peak_m, StatedRun::kSettled_m);
  EXPECT_GT(below.end_s, 10.0);
  const LoopResult above = run(setup, 1.01 * expected, "exact");
  EXPECT_NE(above.behaviour, Behaviour::kStable);
  EXPECT_LT(above.end_s, 20.0) << "two windows that are not less should end it";
}

TEST(ClosedLoop, FurtherRestCountsInNoError) {
  LoopSetup setup;
  setup.hand = hand_of("none");
  constexpr double kStiffness_N_per_m = 270.0;  // just below the limit of the exact force
  const LoopResult stated = run(setup, kStiffness_N_per_m, "rls");
  setup.longest_settling_s = 16.0;
  const LoopResult longer = run(setup, kStiffness_N_per_m, "rls");
  EXPECT_GT(longer.end_s, stated.end_s);
  EXPECT_GT(stated.force_error_percent, 0.0);
  EXPECT_GT(stated.rattle_N, 0.0);
  EXPECT_EQ(stated.force_error_percent, longer.force_error_percent);
  EXPECT_EQ(stated.rattle_N, longer.rattle_N);
}

TEST(OpenLoop, CountsErrorsToTheEndOfAnyMotion) {
  LoopSetup setup;
  setup.errors_from_s = 19.0;  // of 20; the stated run has ended by then
  LinearObject object(200.0, setup.contact_point_W);
  const auto made = make_force_method("hold", {});
  const LoopResult result =
      run_open_loop(setup, evaluation::Trajectory("lissajous"), object, made.get());
  EXPECT_GT(result.reference_rms_N, 0.1);
  EXPECT_GT(result.force_error_percent, 1.0);
}

TEST(ClosedLoop, HoldIsStableUpToTheEigenvalueLimit) {
  for (const char* hand : {"light", "firm", "arm"}) {
    for (const auto& [rate_Hz, delay_s] :
         std::vector<std::pair<double, double>>{{25.0, 0.0}, {50.0, 0.02}, {10.0, 0.1}}) {
      LoopSetup setup = linear_setup(hand, 500.0, "w2_full_speed");
      setup.network.simulator_rate_Hz = rate_Hz;
      setup.network.delay_s = delay_s;
      const double expected = eigenvalue_limit_N_per_m(sampled_spring(
          setup.device, setup.hand, 1.0 / rate_Hz,
          1.0 / rate_Hz + delay_s + setup.timing.count_age_s + setup.timing.actuation_delay_s));
      EXPECT_NEAR(limit_N_per_m(setup, "hold"), expected, kAgreement * expected)
          << hand << ' ' << rate_Hz << " Hz, delay " << delay_s << " s";
    }
  }
}

TEST(ClosedLoop, VirtualDampingMovesTheLimitAsTheEigenvaluesSay) {
  for (const double damping : {-1.0, 1.0, 3.0}) {
    LoopSetup setup = linear_setup("light", 500.0, "ideal");
    setup.virtual_damping_N_s_per_m = damping;
    SampledSpring spring = sampled_spring(setup.device, setup.hand, 0.002, 0.0);
    spring.virtual_damping_N_s_per_m = damping;
    const double expected = eigenvalue_limit_N_per_m(spring);
    EXPECT_NEAR(limit_N_per_m(setup, "exact"), expected, kAgreement * expected) << damping;
  }
}

TEST(ClosedLoop, TheSameSeedGivesTheSameBits) {
  LoopSetup setup;
  setup.timing = device_timing("w2_full_speed");
  setup.hand = hand_of("light");
  setup.network.delay_s = 0.02;
  setup.network.jitter_s = 0.02;
  setup.network.loss = 0.2;
  setup.network.noise_N = 0.01;
  const auto figures = [&](std::uint64_t seed) {
    setup.seed = seed;
    const LoopResult result = run(setup, 200.0, "kriging");
    return std::vector<double>{result.hold_peak_to_peak_m, result.force_error_percent,
                               result.energy_generated_J, result.largest_force_N};
  };
  const std::vector<double> first = figures(7);
  const std::vector<double> again = figures(7);
  EXPECT_EQ(std::memcmp(first.data(), again.data(), first.size() * sizeof(double)), 0);
  EXPECT_NE(first, figures(8));
}

TEST(ClosedLoop, KrigingRendersASpringThatHoldCannot) {
  LoopSetup setup;
  setup.timing = device_timing("ideal");
  setup.hand = hand_of("light");
  EXPECT_NE(run(setup, 200.0, "hold").behaviour, Behaviour::kStable);
  const LoopResult kriging = run(setup, 200.0, "kriging");
  EXPECT_EQ(kriging.behaviour, Behaviour::kStable);
  EXPECT_LT(kriging.force_error_percent, 1.0);  // a linear field
  EXPECT_EQ(kriging.samples_taken, 299U);       // ticks 0..299; the last is still under way
}

TEST(ClosedLoop, HoldGivesEnergyAwayAndTheExactForceHardlyAny) {
  // Held for T_age on average a spring adds the work of a damping of -K T_age.
  LoopSetup setup = linear_setup("firm", 500.0, "ideal");
  const double stiffness_N_per_m = 100.0;
  const LoopResult hold = run(setup, stiffness_N_per_m, "hold");
  const LoopResult exact = run(setup, stiffness_N_per_m, "exact");
  ASSERT_EQ(hold.behaviour, Behaviour::kStable);
  EXPECT_GT(hold.energy_generated_J, 20.0 * std::abs(exact.energy_generated_J));
  EXPECT_GT(exact.energy_generated_J, 0.0) << "sampling by itself leaks K T / 2 of damping";
  EXPECT_NEAR(hold.energy_generated_J / exact.energy_generated_J, (1.5 / 30.0) / (0.5 / 500.0),
              0.2 * 50.0);
}

TEST(ClosedLoop, TheGuardStillsADeviceThatNobodyHoldsBeyondItsOwnLimit) {
  // On a full-speed bus the bare device bears 130 N/m.
  for (const std::string method : {"exact", "kriging", "hold"}) {
    LoopSetup setup;
    setup.timing = device_timing("w2_full_speed");
    setup.hand = hand_of("none");
    setup.network.delay_s = 0.2;
    setup.network.loss = 0.3;
    EXPECT_NE(run(setup, 200.0, method).behaviour, Behaviour::kStable) << method;
    setup.passivity.mode = servo::PassivityMode::kControl;
    const LoopResult guarded = run(setup, 200.0, method);
    EXPECT_EQ(guarded.behaviour, Behaviour::kStable) << method;
    EXPECT_LE(guarded.most_energy_to_hand_J, 1e-3) << method;
  }
}

TEST(ClosedLoop, EverythingIsLostAndNothingIsRendered) {
  LoopSetup setup = linear_setup("firm", 500.0, "ideal");
  setup.hold_s = 4.0;
  setup.network.loss = 1.0;
  const LoopResult result = run(setup, 100.0, "hold");
  EXPECT_EQ(result.samples_taken, 0U);
  EXPECT_EQ(result.samples_lost, 300U);
  EXPECT_EQ(result.largest_force_N, 0.0);
  EXPECT_NEAR(result.force_error_percent, 100.0, 1e-9);
}

TEST(ClosedLoop, ADivergenceEndsTheRunEarly) {
  const LoopResult result = run(linear_setup("light", 500.0, "ideal"), 10000.0, "exact");
  EXPECT_EQ(result.behaviour, Behaviour::kDivergence);
  EXPECT_LT(result.end_s, 6.0);
  EXPECT_TRUE(std::isnan(result.hold_peak_to_peak_m));
}

TEST(ClosedLoop, RefusesATimingThatDoesNotFitIntoACycle) {
  LoopSetup setup = linear_setup("firm", 2000.0, "w2_full_speed");
  EXPECT_THROW(run(setup, 100.0, "exact"), std::invalid_argument);
  setup = linear_setup("firm", 10.0, "ideal");
  EXPECT_THROW(run(setup, 100.0, "exact"), std::invalid_argument);
}

TEST(ClosedLoop, TheGuardLeavesADefaultMethodAtRestThatLearnedItsSpringLate) {
  // The first answer of a simulator at 10 Hz comes when the tool is millimetres within the spring;
  // the exact force alone is stable in all three.
  for (const auto& [hand, timing] : std::vector<std::pair<const char*, const char*>>{
           {"light", "ideal"}, {"light", "w2_full_speed"}, {"firm", "ideal"}}) {
    LoopSetup setup;
    setup.servo_rate_Hz = 1000.0;
    setup.timing = device_timing(timing);
    setup.hand = hand_of(hand);
    setup.network.simulator_rate_Hz = 10.0;
    constexpr double kStiffness_N_per_m = 1600.0;
    ASSERT_EQ(run(setup, kStiffness_N_per_m, "exact").behaviour, Behaviour::kStable) << hand;
    setup.passivity.mode = servo::PassivityMode::kControl;
    const LoopResult result = run(setup, kStiffness_N_per_m, kDefaultMethod);
    EXPECT_EQ(result.behaviour, Behaviour::kStable)
        << hand << ' ' << timing << ": " << to_string(result.behaviour) << ", "
        << 1e3 * result.hold_peak_to_peak_m << " mm";
    EXPECT_LE(result.most_energy_to_hand_J, 1e-3) << hand << ' ' << timing;
    EXPECT_LE(result.rattle_N, 0.02) << hand << ' ' << timing;
  }
}

}  // namespace
}  // namespace forcegrid::stability
