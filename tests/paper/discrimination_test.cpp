// SPDX-License-Identifier: Apache-2.0
#include "paper/discrimination.h"

#include <gtest/gtest.h>

#include "paper/shapes.h"
#include "tests/paper/tiny_scenes.h"

namespace forcegrid::paper {
namespace {

// Three cubes, the first three times as stiff as the second, everywhere alike.
PaperOptions small_plan() {
  PaperOptions options;
  options.jobs = 1;
  options.plan.touches = 6;
  options.plan.contrasts = {1.0, 0.0};
  options.plan.objects = {tiny_scene("stiff", 60.0, 0.1), tiny_scene("soft", 20.0, 0.1),
                          tiny_scene("varied", 35.0, 0.9)};
  return options;
}

const DiscriminationRow& row_of(const Discrimination& all, const std::string& method,
                                Knowledge knowledge, double contrast) {
  for (const DiscriminationRow& row : all.rows) {
    if (row.method == method && row.knowledge == knowledge && row.contrast == contrast &&
        row.weber_fraction == 0.07) {
      return row;
    }
  }
  throw std::out_of_range(method + " is not among the rows");
}

TEST(Discrimination, TellsDifferentObjectsApartAndEqualOnesNot) {
  const PaperOptions options = small_plan();
  const Discrimination all = discriminate(options);
  SCOPED_TRACE("seed " + std::to_string(options.seed));
  for (const std::string& method : discrimination_methods()) {
    for (const Knowledge knowledge : {Knowledge::kSameRendering, Knowledge::kRealForces}) {
      const DiscriminationRow& none = row_of(all, method, knowledge, 0.0);
      EXPECT_EQ(none.answers.trials, 18U) << method;
      EXPECT_EQ(none.answers.right, 6U) << method;  // a guess, always the same one
    }
    // Who has learnt through a method that one object gives three times the other's force knows
    // them by it, however wrong both are.
    const DiscriminationRow& learnt = row_of(all, method, Knowledge::kSameRendering, 1.0);
    EXPECT_EQ(learnt.confusion[0][0], 6U) << method;
    EXPECT_EQ(learnt.confusion[1][1], 6U) << method;
  }
  // With d in metres the forcegrid renders less than half of the stiffness: a stiff object is none
  // that is known.
  const DiscriminationRow& exact = row_of(all, "off-line", Knowledge::kRealForces, 1.0);
  const DiscriminationRow& metres = row_of(all, "forcegrid unit=m", Knowledge::kRealForces, 1.0);
  EXPECT_EQ(exact.answers.right, 18U);
  EXPECT_LT(metres.answers.right, exact.answers.right);
  for (const double percent : all.table_difference_percent) {
    EXPECT_LT(percent, 0.1);
  }
}

// In equilibrium under a displacement all springs' forces may be scaled alike.
TEST(Shapes, AreTheSameWhereSpringsDifferByOneFactor) {
  const std::vector<ShapeDifference> pairs = compare_shapes(small_plan());
  ASSERT_EQ(pairs.size(), 3U);
  EXPECT_LT(pairs[0].largest_mm, 1e-6);
  EXPECT_LT(pairs[0].d_prime, 1e-3);
  EXPECT_GT(pairs[1].rms_mm, 0.01);
  EXPECT_GT(pairs[2].rms_mm, 0.01);
  EXPECT_LT(pairs[1].rms_mm, 16.0);  // no vertex moves further than the tool does
}

}  // namespace
}  // namespace forcegrid::paper
