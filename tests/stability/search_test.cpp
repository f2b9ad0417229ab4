// SPDX-License-Identifier: Apache-2.0
#include "stability/search.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "stability/settling.h"

namespace forcegrid::stability {
namespace {

TEST(FindLimit, BracketsABoundaryToTwoPercent) {
  const StiffnessLimit limit =
      find_limit([](double k) { return k < 777.0 ? Behaviour::kStable : Behaviour::kLimitCycle; });
  EXPECT_LT(limit.largest_stable_N_per_m, 777.0);
  EXPECT_GE(limit.smallest_unstable_N_per_m, 777.0);
  EXPECT_NEAR(limit.smallest_unstable_N_per_m / limit.largest_stable_N_per_m, std::exp2(1.0 / 32.0),
              1e-9);
  EXPECT_EQ(limit.failure, Behaviour::kLimitCycle);
  EXPECT_FALSE(limit.beyond_scan);
}

TEST(FindLimit, StopsAtTheFirstUnstableOctaveAlthoughHigherOnesAreStable) {
  const StiffnessLimit limit = find_limit(
      [](double k) { return k > 30.0 && k < 100.0 ? Behaviour::kDivergence : Behaviour::kStable; });
  EXPECT_LT(limit.largest_stable_N_per_m, 30.0);
  EXPECT_EQ(limit.failure, Behaviour::kDivergence);
}

TEST(FindLimit, TellsNothingStableFromNothingUnstable) {
  const StiffnessLimit none = find_limit([](double) { return Behaviour::kCreep; });
  EXPECT_EQ(none.largest_stable_N_per_m, 0.0);
  EXPECT_EQ(none.failure, Behaviour::kCreep);
  EXPECT_FALSE(none.beyond_scan);
  const StiffnessLimit all = find_limit([](double) { return Behaviour::kStable; });
  EXPECT_EQ(all.largest_stable_N_per_m, StiffnessScan::kMost_N_per_m);
  EXPECT_TRUE(all.beyond_scan);
}

TEST(FindLimit, BeginsWhereItIsToldAndFindsTheSame) {
  for (const double boundary_N_per_m : {30.0, 777.0}) {
    int runs = 0;
    const auto behaviour = [&](double k) {
      ++runs;
      return k < boundary_N_per_m ? Behaviour::kStable : Behaviour::kLimitCycle;
    };
    const StiffnessLimit all = find_limit(behaviour);
    const int runs_of_all = runs;
    runs = 0;
    const StiffnessLimit begun = find_limit(behaviour, 160.0);
    EXPECT_EQ(begun.largest_stable_N_per_m, all.largest_stable_N_per_m);
    EXPECT_EQ(begun.smallest_unstable_N_per_m, all.smallest_unstable_N_per_m);
    EXPECT_EQ(runs, boundary_N_per_m < 160.0 ? runs_of_all + 1 : runs_of_all - 6);
  }
}

std::vector<Eigen::Vector3d> moving(const std::function<double(double)>& z_of_t) {
  std::vector<Eigen::Vector3d> positions_W;
  for (int i = 0; i < 1000; ++i) {
    positions_W.emplace_back(0.1, -0.2, z_of_t(0.002 * i));
  }
  return positions_W;
}

TEST(JudgeSettling, TellsOscillationFromCreep) {
  const Settling still = judge_settling(moving([](double t) { return 0.1e-3 * std::sin(20 * t); }));
  EXPECT_EQ(still.behaviour, Behaviour::kStable);
  EXPECT_NEAR(still.peak_to_peak_m, 0.2e-3, 1e-6);
  const Settling cycle =
      judge_settling(moving([](double t) { return 0.4e-3 * std::sin(20 * t) + 0.1e-3 * t; }));
  EXPECT_EQ(cycle.behaviour, Behaviour::kLimitCycle);
  const Settling creep = judge_settling(
      moving([](double t) { return 1e-3 * (1.0 - std::exp(-t)) + 0.02e-3 * std::sin(20 * t); }));
  EXPECT_EQ(creep.behaviour, Behaviour::kCreep);
}

}  // namespace
}  // namespace forcegrid::stability
