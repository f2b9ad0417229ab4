// SPDX-License-Identifier: Apache-2.0
#include "stability/theory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace forcegrid::stability {
namespace {

TEST(EigenvalueLimit, IsJurysForADampedMassWithoutDelay) {
  // Discretised by hand: with a = exp(-b T / m), c = m (1 - a) / b, h = (1 - a) / b and
  // g = (T - c) / b the loop is [[1 - K g, c], [-K h, a]]; its determinant reaches 1 at
  // K = (1 - a) / (h c - a g), where 1 + trace + determinant is still positive.
  const double m = 0.11;
  const double b = 2.8;
  const double T = 0.002;
  const double a = std::exp(-b * T / m);
  const double c = m * (1.0 - a) / b;
  const double h = (1.0 - a) / b;
  const double g = (T - c) / b;
  const double expected = (1.0 - a) / (h * c - a * g);
  const SampledSpring spring{.mass_kg = m, .damping_N_s_per_m = b, .period_s = T};
  ASSERT_GT(1.0 + (1.0 - expected * g + a) + 1.0, 0.0);
  EXPECT_NEAR(eigenvalue_limit_N_per_m(spring), expected, 2e-4 * expected);
}

TEST(EigenvalueLimit, OfAQuickLoopIsThatOfItsContinuousDelay) {
  // m x'' + b x' = -K x(t - tau): the boundary is where K cos(w tau) = m w^2 and
  // K sin(w tau) = b w. A period of 20 us adds half of it to the delay.
  const double m = 0.26;
  const double b = 10.3;
  for (const double tau : {0.01, 0.05}) {
    double low = 1e-6;
    double high = 1.57 / tau;
    for (int i = 0; i < 100; ++i) {
      const double w = 0.5 * (low + high);
      (b * w * std::cos(w * tau) > m * w * w * std::sin(w * tau) ? low : high) = w;
    }
    const double expected = b * low / std::sin(low * tau);
    const double T = 20e-6;
    const SampledSpring spring{
        .mass_kg = m, .damping_N_s_per_m = b, .period_s = 50 * T, .age_s = tau - 25 * T};
    EXPECT_NEAR(eigenvalue_limit_N_per_m(spring), expected, 0.01 * expected) << "tau " << tau;
  }
}

TEST(EigenvalueLimit, IsTheSameHoweverTheDelayIsSplit) {
  // An age of exactly one period is one whole step, of a little less nearly the same.
  SampledSpring spring{.mass_kg = 0.1,
                       .damping_N_s_per_m = 3.0,
                       .hand_stiffness_N_per_m = 100.0,
                       .period_s = 0.004,
                       .age_s = 0.004};
  const double whole = eigenvalue_limit_N_per_m(spring);
  spring.age_s = 0.004 - 1e-8;
  EXPECT_NEAR(eigenvalue_limit_N_per_m(spring), whole, 1e-3 * whole);
}

TEST(EigenvalueLimit, GrowsWithTheHandsStiffnessAndKnowsNoLimitWithoutAPeriodToSpeakOf) {
  SampledSpring spring{.mass_kg = 0.26, .damping_N_s_per_m = 10.3, .period_s = 0.04, .age_s = 0.04};
  const double free = eigenvalue_limit_N_per_m(spring);
  spring.hand_stiffness_N_per_m = 400.0;
  EXPECT_GT(eigenvalue_limit_N_per_m(spring), free);
  spring.period_s = 1e-7;
  spring.age_s = 0.0;
  EXPECT_EQ(eigenvalue_limit_N_per_m(spring), std::numeric_limits<double>::infinity());
}

TEST(Rules, GiveTheNumbersOfTheirPapers) {
  EXPECT_DOUBLE_EQ(colgate_schenkel_N_per_m(2.8, 0.002, 0.0), 2800.0);
  EXPECT_DOUBLE_EQ(colgate_schenkel_N_per_m(2.8, 0.002, -0.8), 2000.0);
  EXPECT_EQ(colgate_schenkel_N_per_m(1.0, 0.002, 2.0), 0.0);
  // The method study's example: 2.8 Ns/m and 50 ms.
  EXPECT_NEAR(delay_rule_N_per_m(2.8, 0.05), 56.0, 1e-9);
  EXPECT_EQ(delay_rule_N_per_m(2.8, 0.0), std::numeric_limits<double>::infinity());
  EXPECT_DOUBLE_EQ(abbott_okamura_N_per_m(2.8, 0.002, 0.01, 20e-6), 1000.0);
  EXPECT_DOUBLE_EQ(abbott_okamura_N_per_m(2.8, 0.002, 0.1, 20e-6), 2800.0);
  EXPECT_DOUBLE_EQ(abbott_okamura_N_per_m(2.8, 0.002, 0.0, 0.0), 2800.0);
}

}  // namespace
}  // namespace forcegrid::stability
