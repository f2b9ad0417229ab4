// SPDX-License-Identifier: Apache-2.0
#include "paper/observer.h"

#include <gtest/gtest.h>

#include <cmath>

namespace forcegrid::paper {
namespace {

using Eigen::Vector3d;

// Both from Wilson's formula as textbooks tabulate it.
TEST(Proportion, HasWilsonsInterval) {
  const Proportion eight{8, 10};
  EXPECT_DOUBLE_EQ(eight.percent(), 80.0);
  EXPECT_NEAR(eight.low_percent(), 49.02, 0.01);
  EXPECT_NEAR(eight.high_percent(), 94.33, 0.01);
  const Proportion none{0, 10};
  EXPECT_NEAR(none.low_percent(), 0.0, 1e-9);
  EXPECT_NEAR(none.high_percent(), 27.75, 0.01);
}

TEST(Proportion, KnowsNothingWithoutTrials) {
  EXPECT_TRUE(std::isnan(Proportion{}.percent()));
  EXPECT_DOUBLE_EQ(Proportion{}.low_percent(), 0.0);
  EXPECT_DOUBLE_EQ(Proportion{}.high_percent(), 100.0);
}

TEST(FeltNoise, GrowsWithTheForceFromAFloor) {
  const FeltNoise noise{.weber_fraction = 0.1, .floor_N = 0.03, .looks_per_s = 4.0};
  EXPECT_NEAR(noise.sigma_N(Vector3d::Zero()), 0.06, 1e-12);
  EXPECT_NEAR(noise.sigma_N(Vector3d(0.0, 0.4, 0.0)), 2.0 * 0.05, 1e-12);
}

// One second of looks at forces one standard deviation apart: d' = 1, and of two as likely things
// an ideal observer names Phi(1/2) = 69.1 % rightly.
TEST(IdealObserver, IsRightAsOftenAsTheTheoryOfSignalsSays) {
  const FeltNoise noise{.weber_fraction = 0.0, .floor_N = 0.2, .looks_per_s = 10.0};
  const std::vector<std::vector<Vector3d>> known{
      std::vector<Vector3d>(10, Vector3d(1.0, 0.0, 0.0)),
      std::vector<Vector3d>(10, Vector3d(1.2, 0.0, 0.0))};
  constexpr int kTrials = 4000;
  int right = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto which = static_cast<std::size_t>(trial % 2);
    const auto seed = static_cast<std::uint64_t>(1 + trial);
    right += most_likely(feel(known[which], noise, seed), known, noise) == which ? 1 : 0;
  }
  // Three standard deviations of a proportion of 4,000.
  EXPECT_NEAR(100.0 * right / kTrials, 69.1, 2.2) << "seeds 1 to " << kTrials;
}

TEST(IdealObserver, NamesTheFirstOfThingsThatAreTheSame) {
  const std::vector<Vector3d> force(5, Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(most_likely(feel(force, {}, 7), {force, force, force}, {}), 0U);
}

TEST(IdealObserver, FeelsTheSameErrorsWithTheSameSeed) {
  const std::vector<Vector3d> force(5, Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(feel(force, {}, 7), feel(force, {}, 7));
  EXPECT_NE(feel(force, {}, 7), feel(force, {}, 8));
}

}  // namespace
}  // namespace forcegrid::paper
