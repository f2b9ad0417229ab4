// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/solver_kind.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(SolverKind, NamesAreThoseOfTheCommandLine) {
  EXPECT_THAT(solver_names(),
              ElementsAre("auto", "quasi_static", "local", "two_rates", "reduced", "dynamic"));
  EXPECT_STREQ(to_string(SolverKind::kPressed), "pressed");
}

TEST(SolverKind, EveryNameThatCanBeAskedForIsParsed) {
  EXPECT_EQ(parse_solver("auto"), std::nullopt);
  for (const std::string& name : solver_names()) {
    if (const auto kind = parse_solver(name)) {
      EXPECT_EQ(to_string(*kind), name);
    } else {
      EXPECT_EQ(name, "auto");
    }
  }
}

TEST(SolverKind, AnUnknownNameIsRefusedWithTheNearestOne) {
  try {
    parse_solver("quasi-static");
    FAIL() << "an unknown solver was taken";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("the nearest is quasi_static"));
  }
  EXPECT_THROW(parse_solver("pressed"), Error) << "belongs to tools that slide";
}

}  // namespace
}  // namespace forcegrid::simulator
