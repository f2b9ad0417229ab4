// SPDX-License-Identifier: Apache-2.0
#include "tools/dashboard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <string>

namespace forcegrid::tools {
namespace {

using ::testing::HasSubstr;

std::string joined(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) {
    text += line + "\n";
  }
  return text;
}

// Two seconds at 500 Hz, 2 mm/s upward against 3 N; one cycle in a hundred wakes up late.
DashboardPicture two_seconds() {
  DashboardPicture picture(
      {"emulated:woodenhaptics_v2015", "block", "kriging-bank", {"a", "b"}, 500.0});
  for (int i = 0; i <= 1000; ++i) {
    servo::CycleRecord cycle;
    cycle.cycle = static_cast<std::uint64_t>(i);
    cycle.time_ns = 5'000'000'000 + 2'000'000L * i;
    cycle.period_us = 2000.0;
    cycle.wakeup_us = i % 100 == 0 ? 700.0 : 30.0;
    cycle.position_W_m = {0.0, 0.0, 4e-6 * i};
    cycle.commanded_force_D_N = {0.0, 0.0, -3.0};
    cycle.method_force_W_N[0] = {0.0, 0.0, -4.0};
    cycle.missed_deadlines = i == 500 ? 3 : 0;
    cycle.rendered_candidate = 1;
    cycle.in_contact = true;
    picture.add(cycle);
  }
  return picture;
}

TEST(DashboardPicture, FitsEightyByTwentyFour) {
  for (const int rows : {24, 30, 10, 1}) {
    for (const int columns : {80, 200, 20}) {
      const auto lines = two_seconds().lines(columns, rows);
      EXPECT_LE(lines.size(), static_cast<std::size_t>(rows));
      for (const std::string& line : lines) {
        EXPECT_LE(line.size(), static_cast<std::size_t>(columns)) << line;
        for (const char c : line) {
          EXPECT_TRUE(c >= ' ' && c <= '~');
        }
      }
    }
  }
  EXPECT_EQ(two_seconds().lines().size(), 24u);
}

TEST(DashboardPicture, ShowsTheNumbersOfTheRun) {
  const std::string text = joined(two_seconds().lines());
  EXPECT_THAT(text, HasSubstr("500.0 of 500 cycles/s"));
  EXPECT_THAT(text, HasSubstr("missed 3 of 1004"));
  EXPECT_THAT(text, HasSubstr("4.00 N"));
  EXPECT_THAT(text, HasSubstr("3.00 N"));
  EXPECT_THAT(text, HasSubstr("(b)"));
  EXPECT_THAT(text, HasSubstr("-12.00 mJ in all"));  // -3 N over 4 mm
  EXPECT_THAT(text, HasSubstr("2.0 s"));
  EXPECT_THAT(text, HasSubstr("  1000   1.099 %"));  // 11 of 1001 between 500 and 1000 us
  EXPECT_THAT(text, HasSubstr("Ctrl-C"));
}

TEST(DashboardPicture, ShowsTheNewestNoteWithoutItsControls) {
  DashboardPicture picture = two_seconds();
  picture.note("the simulator process\nended\x1b[2J");
  EXPECT_EQ(picture.lines().back(), "the simulator process ended [2J");
}

TEST(DashboardPicture, IsThereBeforeTheFirstCycle) {
  const DashboardPicture picture({"d", "s", "m", {}, 500.0});
  EXPECT_EQ(picture.lines().size(), 24u);
}

}  // namespace
}  // namespace forcegrid::tools
