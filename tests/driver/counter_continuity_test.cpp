// SPDX-License-Identifier: Apache-2.0
#include "driver/counter_continuity.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <string>

#include "profiles/device_profile.h"

namespace forcegrid::driver {
namespace {

using Counts = std::array<std::int32_t, 6>;

std::string doubt(const Counts& last, const Counts& now) {
  const auto mechanism = make_mechanism(profiles::load_device_profile("woodenhaptics_v2015"));
  return why_counters_are_lost(*mechanism, last, now);
}

// Sheet, 11.4 and 11.1: the workspace's origin, and a pose 250 mm from it.
constexpr Counts kOrigin = {0, 1313, 2535, 0, 0, 0};
constexpr Counts kElsewhere = {1000, 2000, 6500, 0, 0, 0};

TEST(CounterContinuity, BelievesCountersThatAreWhereTheyWere) {
  EXPECT_EQ(doubt(kOrigin, kOrigin), "");
  EXPECT_EQ(doubt(kOrigin, {20, 1330, 2500, 0, 0, 0}), "");  // some millimetres on
}

TEST(CounterContinuity, DoubtsCountersThatStartFromZero) {
  EXPECT_NE(doubt(kOrigin, {0, -3, 7, 0, 0, 0}).find("lost power"), std::string::npos);
}

TEST(CounterContinuity, DoubtsCountersOfNoPose) {
  // The shoulder 300 degrees down.
  EXPECT_NE(doubt(kOrigin, {0, -20000, 0, 0, 0, 0}).find("no pose"), std::string::npos);
}

TEST(CounterContinuity, DoubtsCountersThatHaveMovedAndSaysHowFar) {
  // From the origin to the sheet's (0.118767150201, 0.067384975837, 0.209514124870) m.
  EXPECT_NE(doubt(kOrigin, kElsewhere).find("250 mm"), std::string::npos)
      << doubt(kOrigin, kElsewhere);
}

}  // namespace
}  // namespace forcegrid::driver
