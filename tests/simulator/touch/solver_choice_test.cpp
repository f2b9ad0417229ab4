// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/solver_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(SolverChoice, SolvesTheWholeObjectWhereThatIsInTime) {
  const SolverChoice choice = choose_solver(std::nullopt, 10'164, 30.0, {});
  EXPECT_EQ(choice.kind, SolverKind::kQuasiStatic);
  EXPECT_EQ(choice.options.border_tolerance, 0.0);
  EXPECT_FALSE(choice.small_enough_for_direct);
  EXPECT_THAT(choice.why, HasSubstr("10164 vertices to a residual of 0.001"));
  EXPECT_THAT(choice.why, HasSubstr("of the 33.3 ms"));
  EXPECT_THAT(choice.why, Not(HasSubstr("direct")));
}

TEST(SolverChoice, SolvesWhatIsDisturbedWhereTheWholeWouldBeLate) {
  const SolverChoice choice = choose_solver(std::nullopt, 99'000, 30.0, {});
  EXPECT_EQ(choice.kind, SolverKind::kLocal);
  EXPECT_GT(choice.options.border_tolerance, 0.0);
  EXPECT_THAT(choice.why, HasSubstr("only the region that the tool disturbs"));
  EXPECT_EQ(choose_solver(std::nullopt, 10'164, 200.0, {}).kind, SolverKind::kLocal)
      << "the rate counts, too";
}

TEST(SolverChoice, ATighterToleranceTakesLonger) {
  // 20,000 vertices: 28 ms to 1e-3, a quarter more or less a decade, against 22 ms.
  SolverOptions coarse{.relative_tolerance = 1e-2};
  SolverOptions fine{.relative_tolerance = 1e-5};
  EXPECT_EQ(choose_solver(std::nullopt, 20'000, 30.0, coarse).kind, SolverKind::kQuasiStatic);
  EXPECT_EQ(choose_solver(std::nullopt, 20'000, 30.0, fine).kind, SolverKind::kLocal);
}

TEST(SolverChoice, SaysWhereTheServoCanSolveTheObjectItself) {
  const SolverChoice choice = choose_solver(std::nullopt, 1'089, 30.0, {});
  EXPECT_TRUE(choice.small_enough_for_direct);
  EXPECT_THAT(choice.why, HasSubstr("--method direct"));
}

TEST(SolverChoice, AnObjectWithDampersMovesAndOneWithMassesAloneIsSolvedByEquilibria) {
  const SolverChoice damped = choose_solver(std::nullopt, 500, 30.0, {}, MeshDynamics::kDamped);
  EXPECT_EQ(damped.kind, SolverKind::kDynamic);
  EXPECT_THAT(damped.why, HasSubstr("dampers"));
  EXPECT_THAT(damped.why, Not(HasSubstr("direct")));
  EXPECT_EQ(damped.dynamic.step_s, DynamicOptions{}.step_s);
  const SolverChoice heavy = choose_solver(std::nullopt, 500, 30.0, {}, MeshDynamics::kMasses);
  EXPECT_EQ(heavy.kind, SolverKind::kQuasiStatic);
  EXPECT_THAT(heavy.why, HasSubstr("--solver dynamic"));
  EXPECT_EQ(choose_solver(SolverKind::kDynamic, 500, 30.0, {}, MeshDynamics::kMasses).kind,
            SolverKind::kDynamic);
  EXPECT_THAT(choose_solver(SolverKind::kQuasiStatic, 500, 30.0, {}, MeshDynamics::kDamped).why,
              HasSubstr("masses and dampers are ignored"));
  EXPECT_THROW(choose_solver(SolverKind::kDynamic, 500, 30.0, {}), Error);
}

TEST(SolverChoice, LargerObjectsGetLongerTimeSteps) {
  // 10,000 vertices of 0.7 us and step: 3 steps fit into two thirds of 33.3 ms.
  const SolverChoice large = choose_solver(std::nullopt, 10'000, 30.0, {}, MeshDynamics::kDamped);
  EXPECT_NEAR(large.dynamic.step_s, 1.0 / 30.0 / 3.0, 1e-9);
  EXPECT_EQ(large.dynamic.max_steps, 9);
  const SolverChoice huge = choose_solver(std::nullopt, 1'000'000, 30.0, {}, MeshDynamics::kDamped);
  EXPECT_NEAR(huge.dynamic.step_s, 1.0 / 30.0, 1e-9) << "one step an answer";
}

TEST(SolverChoice, TwoRatesSolvesAsDirectDoesFromTheServosRateOn) {
  const SolverChoice servo = choose_solver(SolverKind::kTwoRates, 100'000, 500.0, {});
  EXPECT_THAT(servo.why, HasSubstr("2500 vertices around the tool"));
  EXPECT_GT(servo.two_rates.near.answer_first_below, 0.0);
  EXPECT_EQ(servo.options.border_tolerance, 0.0) << "queries are answered by the whole object";
  const SolverOptions fine{.relative_tolerance = 1e-4, .border_tolerance = 0.01};
  const SolverChoice slow = choose_solver(SolverKind::kTwoRates, 100'000, 30.0, fine);
  EXPECT_EQ(slow.two_rates.near.answer_first_below, 0.0);
  EXPECT_EQ(slow.two_rates.near.max_steps, SolverOptions{}.max_steps);
  EXPECT_EQ(slow.two_rates.near.relative_tolerance, 1e-4);
  EXPECT_EQ(slow.two_rates.whole.relative_tolerance, 1e-4);
  EXPECT_EQ(slow.two_rates.whole.border_tolerance, 0.0);
}

TEST(SolverChoice, TwoRatesIsRefusedForAnObjectWithDampers) {
  try {
    choose_solver(SolverKind::kTwoRates, 500, 30.0, {}, MeshDynamics::kDamped);
    FAIL() << "a part of a damped object was taken for the whole";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("dampers"));
    EXPECT_THAT(error.what(), HasSubstr("quasi_static"));
  }
  EXPECT_EQ(choose_solver(SolverKind::kTwoRates, 500, 30.0, {}, MeshDynamics::kMasses).kind,
            SolverKind::kTwoRates);
}

TEST(SolverChoice, TakesWhatIsAskedFor) {
  EXPECT_EQ(choose_solver(SolverKind::kLocal, 100, 30.0, {}).kind, SolverKind::kLocal);
  EXPECT_GT(choose_solver(SolverKind::kLocal, 100, 30.0, {}).options.border_tolerance, 0.0);
  EXPECT_EQ(choose_solver(SolverKind::kLocal, 100, 30.0, {.border_tolerance = 0.02})
                .options.border_tolerance,
            0.02);
  EXPECT_EQ(choose_solver(SolverKind::kQuasiStatic, 1'000'000, 30.0, {}).kind,
            SolverKind::kQuasiStatic);
}

}  // namespace
}  // namespace forcegrid::simulator
