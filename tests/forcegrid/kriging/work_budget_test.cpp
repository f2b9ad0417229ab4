// SPDX-License-Identifier: Apache-2.0
// What `auto` does within a budget: what it has, that the modelled mean cost stays within it, and
// that samples that it can't pay for are counted and do not delay the newest.

#include "forcegrid/kriging/work_budget.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <string>

#include "forcegrid/kriging/ensemble_method.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "tests/forcegrid/kriging/kriging_play.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using kriging::CostModel;
using kriging::plan_for;
using kriging::WorkBudget;
using namespace testing;

MethodOptions with_budget(double reads) {
  MethodOptions options;
  options.budget_reads = reads;
  return options;
}

std::uint64_t counter(const ForceMethod& method, const std::string& name) {
  for (const NamedCounter& each : method.counters()) {
    if (name == each.name) {
      return each.value;
    }
  }
  ADD_FAILURE() << "no counter " << name;
  return 0;
}

TEST(BudgetPlan, HasMoreForMore) {
  int samples = 0;
  bool ensemble = false;
  for (double reads = 20.0; reads < 3000.0; reads *= 1.2) {
    const kriging::BudgetPlan plan = plan_for(reads);
    EXPECT_GE(plan.samples, samples) << reads;
    EXPECT_TRUE(plan.ensemble || !ensemble) << reads;
    samples = plan.samples;
    ensemble = plan.ensemble;
  }
  EXPECT_TRUE(ensemble);
  EXPECT_EQ(plan_for(std::nullopt).samples, samples);
  EXPECT_TRUE(plan_for(std::nullopt).ensemble);
}

TEST(BudgetPlan, RefusesWhatPaysForNothingAndSaysTheLeast) {
  try {
    static_cast<void>(make_force_method("auto", with_budget(1.0)));
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("give at least"), std::string::npos) << error.what();
  }
}

// The purse's arithmetic against a plain sum.
TEST(WorkBudget, KeepsTheMeanOfPiecesOfAnySize) {
  constexpr double kReads = 40.0;
  constexpr int kCycles = 20'000;
  constexpr int kLargestPiece = 4000;
  std::mt19937 random(kSeed);
  std::uniform_int_distribution<int> units(1, kLargestPiece);
  WorkBudget budget(kReads);
  double spent = 0.0;
  for (int i = 0; i < kCycles; ++i) {
    budget.begin_cycle(10);
    spent += CostModel::cycle_reads(10);
    while (budget.allows()) {
      const int piece = units(random);
      budget.spend(piece);
      spent += CostModel::piece_reads(piece);
    }
  }
  const double saved = WorkBudget::kSaved_cycles * kReads;
  EXPECT_LE(spent, kCycles * kReads + saved + CostModel::piece_reads(kLargestPiece));
  EXPECT_GE(spent, kCycles * kReads) << "and what is there is used; seed " << kSeed;
}

TEST(WorkBudget, KeepsAnotherMeanFromWhenItIsSet) {
  WorkBudget budget(std::nullopt);
  constexpr int kPiece = 500;
  for (const double reads : {60.0, 30.0, 200.0}) {
    budget.set(reads);
    double spent = 0.0;
    constexpr int kCycles = 20'000;
    for (int i = 0; i < kCycles; ++i) {
      budget.begin_cycle(10);
      spent += CostModel::cycle_reads(10);
      while (budget.allows()) {
        budget.spend(kPiece);
        spent += CostModel::piece_reads(kPiece);
      }
    }
    // What was saved up at the start, and one piece of debt.
    const double slack = WorkBudget::kSaved_cycles * reads + CostModel::piece_reads(kPiece);
    EXPECT_NEAR(spent, kCycles * reads, slack) << reads;
  }
  budget.set(std::numeric_limits<double>::infinity());
  EXPECT_FALSE(budget.limited());
  budget.spend(1 << 30);
  EXPECT_TRUE(budget.allows());
}

TEST(WorkBudget, WithoutALimitAllowsEverything) {
  WorkBudget budget(std::nullopt);
  budget.spend(1 << 30);
  EXPECT_TRUE(budget.allows());
  EXPECT_TRUE(budget.allows_others());
}

// The budget decides when work is done: what force() answers does not change at once.
TEST(AutoWithBudget, TakesAnotherBudgetWithoutAStepInTheForce) {
  const AnchoredSprings object(kSeed);
  EnsembleMethod method(EnsembleMethod::Kind::kAuto, {});
  ASSERT_TRUE(method.least_budget_reads());
  Play play = hand_on(object);
  play.work_budget = 1000;
  play.run(method);
  const double time_s = 1e3;
  const Vector3d place_W = kPoint_W + Vector3d(0.002, 0.001, 0.004);
  const Vector3d before_N = method.force(time_s, place_W).force_W;
  EXPECT_GT(before_N.norm(), 0.05);
  for (const double reads :
       {*method.least_budget_reads(), 1e4, std::numeric_limits<double>::infinity()}) {
    method.set_budget(reads);
    EXPECT_EQ(method.force(time_s, place_W).force_W, before_N) << reads;
  }
  EnsembleMethod without(EnsembleMethod::Kind::kKriging, {});
  EXPECT_FALSE(without.least_budget_reads());
}

TEST(AutoWithBudget, IsMoreAccurateWithMore) {
  const AnchoredSprings object(kSeed);
  double error = 1.0;
  for (const double reads : {25.0, 75.0, 250.0}) {
    EnsembleMethod method(EnsembleMethod::Kind::kAuto, with_budget(reads));
    Play play = hand_on(object);
    play.work_budget = 1000;
    play.run(method);
    EXPECT_EQ(method.candidates().size(), 1U) << reads;
    EXPECT_EQ(counter(method, "samples_over_budget") > 0, reads < 30.0) << reads;
    EXPECT_LT(play.error_after_1s, error) << reads;
    error = play.error_after_1s;
  }
  EXPECT_LT(error, 0.005);
}

// Three hundred samples a second are ten times what a budget reckons with.
TEST(AutoWithBudget, LeavesOutSamplesThatItCantPayForButTakesTheNewest) {
  const AnchoredSprings object(kSeed);
  EnsembleMethod method(EnsembleMethod::Kind::kAuto, with_budget(25.0));
  method.contact_made(1, kPoint_W);
  const HandMotion motion(kSeed);
  double worst_N = 0.0;
  int taken = 0;
  for (int i = 0; i < 4000; ++i) {
    const double t_s = i * kServo_s;
    const Vector3d d_m = motion.position_m(t_s);
    if (i % 2 == 0) {
      Sample sample;
      sample.time_s = t_s;
      sample.position_W = kPoint_W + d_m;
      sample.force_W = object.force_N(d_m);
      method.take_sample(sample);
      ++taken;
    }
    method.observe(t_s, kPoint_W + d_m);
    if (i > 500) {
      const ForceEstimate estimate = method.force(t_s, kPoint_W + d_m);
      worst_N = std::max(worst_N, (estimate.force_W - object.force_N(d_m)).norm());
    }
    method.work(1000);
  }
  const auto left_out = static_cast<int>(counter(method, "samples_over_budget"));
  EXPECT_GT(left_out, taken / 2);
  EXPECT_LT(left_out, taken);
  EXPECT_GT(counter(method, "cycles_over_budget"), 0U);
  // An old sample in the newest one's place would be wrong by newtons: the hand moves at 0.1 m/s.
  EXPECT_LT(worst_N, 0.6) << "seed " << kSeed;
}

TEST(AutoWithBudget, HasTheWholeEnsembleWhereItPays) {
  EnsembleMethod method(EnsembleMethod::Kind::kAuto, with_budget(2500.0));
  EXPECT_GT(method.candidates().size(), 8U);
}

TEST(MethodVariant, TakesABudgetInReads) {
  EXPECT_EQ(parse_method_variant("auto budget=75", {}).options.budget_reads, 75.0);
  EXPECT_THROW(parse_method_variant("auto budget=0", {}), std::invalid_argument);
  EXPECT_THROW(parse_method_variant("auto budget=1us", {}), std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid
