#include "simulator/solver_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "simulator/error.h"

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
