#include "simulator/touch/solver_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(SolverChoice, SolvesTheWholeObjectWhereThatIsInTime) {
  const SolverChoice choice = choose_solver("auto", 10'164, 30.0, {});
  EXPECT_EQ(choice.name, "quasi_static");
  EXPECT_EQ(choice.options.border_tolerance, 0.0);
  EXPECT_FALSE(choice.small_enough_for_direct);
  EXPECT_THAT(choice.why, HasSubstr("10164 vertices to a residual of 0.001"));
  EXPECT_THAT(choice.why, HasSubstr("of the 33.3 ms"));
  EXPECT_THAT(choice.why, Not(HasSubstr("direct")));
}

TEST(SolverChoice, SolvesWhatIsDisturbedWhereTheWholeWouldBeLate) {
  const SolverChoice choice = choose_solver("auto", 99'000, 30.0, {});
  EXPECT_EQ(choice.name, "local");
  EXPECT_GT(choice.options.border_tolerance, 0.0);
  EXPECT_THAT(choice.why, HasSubstr("only what the tool disturbs"));
  EXPECT_EQ(choose_solver("auto", 10'164, 200.0, {}).name, "local") << "the rate counts, too";
}

TEST(SolverChoice, ATighterToleranceTakesLonger) {
  // 20,000 vertices: 28 ms to 1e-3, a quarter more or less a decade, against 22 ms.
  SolverOptions coarse{.relative_tolerance = 1e-2};
  SolverOptions fine{.relative_tolerance = 1e-5};
  EXPECT_EQ(choose_solver("auto", 20'000, 30.0, coarse).name, "quasi_static");
  EXPECT_EQ(choose_solver("auto", 20'000, 30.0, fine).name, "local");
}

TEST(SolverChoice, SaysWhereTheServoCanSolveTheObjectItself) {
  const SolverChoice choice = choose_solver("auto", 1'089, 30.0, {});
  EXPECT_TRUE(choice.small_enough_for_direct);
  EXPECT_THAT(choice.why, HasSubstr("--method direct"));
}

TEST(SolverChoice, AnObjectWithDampersMovesAndOneWithMassesAloneIsSolvedByEquilibria) {
  const SolverChoice damped = choose_solver("auto", 500, 30.0, {}, MeshDynamics::kDamped);
  EXPECT_EQ(damped.name, "dynamic");
  EXPECT_THAT(damped.why, HasSubstr("dampers"));
  EXPECT_THAT(damped.why, Not(HasSubstr("direct")));
  EXPECT_EQ(damped.dynamic.step_s, DynamicOptions{}.step_s);
  const SolverChoice heavy = choose_solver("auto", 500, 30.0, {}, MeshDynamics::kMasses);
  EXPECT_EQ(heavy.name, "quasi_static");
  EXPECT_THAT(heavy.why, HasSubstr("--solver dynamic"));
  EXPECT_EQ(choose_solver("dynamic", 500, 30.0, {}, MeshDynamics::kMasses).name, "dynamic");
  EXPECT_THAT(choose_solver("quasi_static", 500, 30.0, {}, MeshDynamics::kDamped).why,
              HasSubstr("left out"));
  EXPECT_THROW(choose_solver("dynamic", 500, 30.0, {}), Error);
}

TEST(SolverChoice, LargerObjectsGetLongerTimeSteps) {
  // 10,000 vertices of 0.7 us and step: 3 steps fit into two thirds of 33.3 ms.
  const SolverChoice large = choose_solver("auto", 10'000, 30.0, {}, MeshDynamics::kDamped);
  EXPECT_NEAR(large.dynamic.step_s, 1.0 / 30.0 / 3.0, 1e-9);
  EXPECT_EQ(large.dynamic.max_steps, 9);
  const SolverChoice huge = choose_solver("auto", 1'000'000, 30.0, {}, MeshDynamics::kDamped);
  EXPECT_NEAR(huge.dynamic.step_s, 1.0 / 30.0, 1e-9) << "one step an answer";
}

TEST(SolverChoice, TwoRatesSolvesAsDirectDoesFromTheServosRateOn) {
  const SolverChoice servo = choose_solver("two_rates", 100'000, 500.0, {});
  EXPECT_THAT(servo.why, HasSubstr("2500 vertices around the tool"));
  EXPECT_GT(servo.two_rates.near.answer_first_below, 0.0);
  EXPECT_EQ(servo.options.border_tolerance, 0.0) << "queries are answered by the whole object";
  const SolverOptions fine{.relative_tolerance = 1e-4, .border_tolerance = 0.01};
  const SolverChoice slow = choose_solver("two_rates", 100'000, 30.0, fine);
  EXPECT_EQ(slow.two_rates.near.answer_first_below, 0.0);
  EXPECT_EQ(slow.two_rates.near.max_steps, SolverOptions{}.max_steps);
  EXPECT_EQ(slow.two_rates.near.relative_tolerance, 1e-4);
  EXPECT_EQ(slow.two_rates.whole.relative_tolerance, 1e-4);
  EXPECT_EQ(slow.two_rates.whole.border_tolerance, 0.0);
}

TEST(SolverChoice, TwoRatesIsRefusedForAnObjectWithDampers) {
  try {
    choose_solver("two_rates", 500, 30.0, {}, MeshDynamics::kDamped);
    FAIL() << "a part of a damped object was taken for the whole";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("dampers"));
    EXPECT_THAT(error.what(), HasSubstr("quasi_static"));
  }
  EXPECT_EQ(choose_solver("two_rates", 500, 30.0, {}, MeshDynamics::kMasses).name, "two_rates");
}

TEST(SolverChoice, TakesWhatIsAskedForAndRefusesTheUnknown) {
  EXPECT_EQ(choose_solver("local", 100, 30.0, {}).name, "local");
  EXPECT_GT(choose_solver("local", 100, 30.0, {}).options.border_tolerance, 0.0);
  EXPECT_EQ(choose_solver("local", 100, 30.0, {.border_tolerance = 0.02}).options.border_tolerance,
            0.02);
  EXPECT_EQ(choose_solver("quasi_static", 1'000'000, 30.0, {}).name, "quasi_static");
  try {
    choose_solver("quasi-static", 100, 30.0, {});
    FAIL() << "an unknown solver was taken";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("the nearest is quasi_static"));
  }
}

}  // namespace
}  // namespace forcegrid::simulator
