// SPDX-License-Identifier: Apache-2.0
#include "link/clock_estimate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "link/replay_window.h"

namespace forcegrid::link {
namespace {

constexpr double kTolerance_s = 1e-12;  // rounding only
constexpr std::int64_t kMillisecond_ns = 1'000'000;

/// A round trip at `start_ns` with the given ways and wait; the peer's clock is `offset_ns` ahead.
RoundTrip trip(std::int64_t start_ns, std::int64_t there_ns, std::int64_t wait_ns,
               std::int64_t back_ns, std::int64_t offset_ns) {
  return {start_ns, start_ns + there_ns + offset_ns, start_ns + there_ns + wait_ns + offset_ns,
          start_ns + there_ns + wait_ns + back_ns};
}

TEST(ClockFilter, KnowsNothingBeforeTheFirstRoundTrip) {
  EXPECT_FALSE(ClockFilter().estimate().known);
}

TEST(ClockFilter, FindsTheOffsetExactlyWhereBothWaysTakeAsLong) {
  ClockFilter filter;
  filter.add(trip(7'000, 3 * kMillisecond_ns, 33 * kMillisecond_ns, 3 * kMillisecond_ns,
                  -5'000 * kMillisecond_ns));
  EXPECT_TRUE(filter.estimate().known);
  EXPECT_NEAR(filter.estimate().offset_s, -5.0, kTolerance_s);
  EXPECT_NEAR(filter.estimate().round_trip_s, 6e-3, kTolerance_s);
}

TEST(ClockFilter, ErrsByAtMostHalfTheQuickestRoundTrip) {
  std::mt19937 random(5);
  std::exponential_distribution<double> queueing_ms(0.2);
  const std::int64_t offset_ns = 123'456'789'012;
  ClockFilter filter;
  for (int i = 0; i < 1000; ++i) {
    const auto there_ns = static_cast<std::int64_t>(1e6 * (1.0 + queueing_ms(random)));
    const auto back_ns = static_cast<std::int64_t>(1e6 * (1.0 + queueing_ms(random)));
    filter.add(trip(i * 33 * kMillisecond_ns, there_ns, 20 * kMillisecond_ns, back_ns, offset_ns));
    const ClockEstimate estimate = filter.estimate();
    EXPECT_LE(std::abs(estimate.offset_s - 1e-9 * static_cast<double>(offset_ns)),
              0.5 * estimate.round_trip_s + kTolerance_s);
    EXPECT_GE(estimate.round_trip_s, 2e-3);
  }
}

TEST(ClockFilter, ForgetsWhatIsOlderThanItsWindow) {
  ClockFilter filter;
  filter.add(trip(0, kMillisecond_ns, 0, kMillisecond_ns, 0));
  for (std::size_t i = 0; i < ClockFilter::kWindow; ++i) {
    filter.add(trip(0, 4 * kMillisecond_ns, 0, 4 * kMillisecond_ns, kMillisecond_ns));
  }
  EXPECT_NEAR(filter.estimate().offset_s, 1e-3, kTolerance_s);
  EXPECT_NEAR(filter.estimate().round_trip_s, 8e-3, kTolerance_s);
}

TEST(ClockFilter, LeavesOutWhatCanNotHaveBeen) {
  ClockFilter filter;
  filter.add(trip(0, kMillisecond_ns, -kMillisecond_ns, 9 * kMillisecond_ns, 0));  // waited < 0
  filter.add(trip(0, 1, 33 * kMillisecond_ns, -kMillisecond_ns, 0));  // back before it was sent
  EXPECT_FALSE(filter.estimate().known);
}

TEST(ReplayWindow, LetsEachCounterPassOnceInAnyOrder) {
  ReplayWindow window;
  EXPECT_FALSE(window.pass(0));
  EXPECT_TRUE(window.pass(3));
  EXPECT_TRUE(window.pass(1));
  EXPECT_TRUE(window.pass(2));
  for (const std::uint64_t counter : {1U, 2U, 3U}) {
    EXPECT_FALSE(window.pass(counter));
  }
}

TEST(ReplayWindow, ForgetsNothingThatItCouldLetPassAgain) {
  ReplayWindow window;
  EXPECT_TRUE(window.pass(5000));
  EXPECT_TRUE(window.pass(5000 - ReplayWindow::kWindow + 1));
  EXPECT_FALSE(window.pass(5000 - ReplayWindow::kWindow));
  EXPECT_TRUE(window.pass(1'000'000));  // a jump clears the window
  EXPECT_FALSE(window.pass(5000));
  EXPECT_TRUE(window.pass(999'999));
  EXPECT_TRUE(window.pass(UINT64_MAX));
  EXPECT_FALSE(window.pass(UINT64_MAX));
  EXPECT_FALSE(window.pass(1'000'000));
}

TEST(ReplayWindow, AgreesWithAListOfAllThatPassed) {
  std::mt19937 random(11);
  ReplayWindow window;
  std::vector<bool> passed(20'000, false);
  std::uint64_t highest = 0;
  for (int i = 0; i < 100'000; ++i) {
    const std::uint64_t counter = std::max<std::int64_t>(
        1, static_cast<std::int64_t>(i / 6) - 600 + static_cast<std::int64_t>(random() % 1300));
    const bool expected =
        counter > highest || (highest - counter < ReplayWindow::kWindow && !passed[counter]);
    EXPECT_EQ(window.pass(counter), expected) << counter;
    passed[counter] = passed[counter] || expected;
    highest = std::max(highest, counter);
  }
}

}  // namespace
}  // namespace forcegrid::link
