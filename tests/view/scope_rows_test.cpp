// SPDX-License-Identifier: Apache-2.0
#include "view/scope_rows.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string>

namespace forcegrid::view {
namespace {

using view_link::FeedCycle;

constexpr std::int64_t kStart_ns = 5'000'000'000'123;

std::size_t column(const std::string& name) {
  const auto& names = scope_columns();
  const auto found = std::find(names.begin(), names.end(), name);
  EXPECT_NE(found, names.end()) << name;
  return static_cast<std::size_t>(found - names.begin());
}

float value(const ScopeRow& row, const std::string& name) { return row.value[column(name)]; }

FeedCycle cycle_at(std::int64_t since_start_ns) {
  FeedCycle cycle;
  cycle.time_ns = kStart_ns + since_start_ns;
  return cycle;
}

TEST(ScopeColumns, HaveEachNameOnce) {
  const auto& names = scope_columns();
  EXPECT_EQ(names.size(), kScopeColumns);
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), names.size());
  EXPECT_EQ(names.front(), "time_s");
  EXPECT_EQ(names.back(), "cycle");
  EXPECT_EQ(column("force_N"), 7U);
  EXPECT_EQ(column("method3_z_N"), 19U);
}

TEST(ScopeRows, HaveWhatAPersonMayChange) {
  ScopeRows rows(1);
  FeedCycle cycle = cycle_at(0);
  cycle.sample_period_ms = 33.25;
  cycle.requests_per_s = 120.0;
  cycle.budget_reads = 75.0;
  cycle.arrivals_taken = (std::uint64_t{1} << 24) + 5;
  rows.add(cycle);
  const ScopeRow row = *rows.take_rest();
  EXPECT_EQ(value(row, "sample_period_ms"), 33.25F);
  EXPECT_EQ(value(row, "requests_per_s"), 120.0F);
  EXPECT_EQ(value(row, "budget_reads"), 75.0F);
  EXPECT_EQ(value(row, "arrivals"), 5.0F);
  cycle.budget_reads = std::nan("");
  rows.add(cycle);
  EXPECT_TRUE(std::isnan(value(*rows.take_rest(), "budget_reads")));
}

TEST(ScopeRows, EndABucketEveryTenMilliseconds) {
  ScopeRows rows(1);
  // 500 Hz: cycles 0..4 are in the first bucket, 5..9 in the second.
  std::vector<ScopeRow> taken;
  for (int i = 0; i < 11; ++i) {
    FeedCycle cycle = cycle_at(2'000'000 * i);
    cycle.cycle = 100 + static_cast<std::uint64_t>(i);
    if (const auto row = rows.add(cycle)) {
      taken.push_back(*row);
    }
  }
  ASSERT_EQ(taken.size(), 2U);
  EXPECT_DOUBLE_EQ(taken[0].time_s, 0.008);
  EXPECT_EQ(value(taken[0], "cycle"), 104.0F);
  EXPECT_DOUBLE_EQ(taken[1].time_s, 0.018);
  EXPECT_EQ(value(taken[1], "cycle"), 109.0F);
  const auto rest = rows.take_rest();
  ASSERT_TRUE(rest);
  EXPECT_EQ(value(*rest, "cycle"), 110.0F);
  EXPECT_FALSE(rows.take_rest());
}

TEST(ScopeRows, HaveNoneForABucketWithoutACycle) {
  ScopeRows rows(1);
  EXPECT_FALSE(rows.add(cycle_at(0)));
  EXPECT_TRUE(rows.add(cycle_at(1'000'000'000)));
  const auto row = rows.add(cycle_at(1'000'000'000 + kBucket_ns));
  ASSERT_TRUE(row);
  EXPECT_DOUBLE_EQ(row->time_s, 1.0);
}

TEST(ScopeRows, HoldTheNewestTheLargestTheSumAndTheUnion) {
  ScopeRows rows(2);
  FeedCycle first = cycle_at(0);
  first.position_W_m = {0.001, 0.002, 0.003};
  first.commanded_force_W_N = {1, 1, 1};
  first.period_us = 2100;
  first.wakeup_us = 4;
  first.compute_us = 60;
  first.report_age_us = 700;
  first.limits_acted = 0b0001;
  first.fault = 3;
  first.missed_deadlines = 2;
  FeedCycle second = cycle_at(2'000'000);
  second.position_W_m = {-0.010, 0.020, 0.0305};
  second.commanded_force_W_N = {2, -3, 6};
  second.method_force_W_N[0] = {0.5, 0.25, 0.125};
  second.method_force_W_N[1] = {8, 9, 10};
  second.method_uncertainty_N = {0.75, std::nan(""), 5, 5};
  second.period_us = 1900;
  second.wakeup_us = 9;
  second.compute_us = 55;
  second.report_age_us = 600;
  second.sample_age_ms = 33.5;
  second.energy_to_hand_J = -0.0025;
  second.gain = 0.5;
  second.damping_gain = 0.25;
  second.rendered_candidate = 2;
  second.rendered_reason = 1;
  second.rung = 4;
  second.held_back = 5;
  second.limits_acted = 0b0110;
  second.in_contact = 1;
  second.paused = 1;
  second.rendered_method = 2;
  second.missed_deadlines = 3;
  second.cycle = 77;
  EXPECT_FALSE(rows.add(first));
  EXPECT_FALSE(rows.add(second));
  const auto row = rows.take_rest();
  ASSERT_TRUE(row);
  EXPECT_FLOAT_EQ(value(*row, "position_x_mm"), -10);
  EXPECT_FLOAT_EQ(value(*row, "position_y_mm"), 20);
  EXPECT_FLOAT_EQ(value(*row, "position_z_mm"), 30.5);
  EXPECT_FLOAT_EQ(value(*row, "force_x_N"), 2);
  EXPECT_FLOAT_EQ(value(*row, "force_y_N"), -3);
  EXPECT_FLOAT_EQ(value(*row, "force_z_N"), 6);
  EXPECT_FLOAT_EQ(value(*row, "force_N"), 7);  // sqrt(4 + 9 + 36)
  EXPECT_FLOAT_EQ(value(*row, "method0_y_N"), 0.25);
  EXPECT_FLOAT_EQ(value(*row, "method1_z_N"), 10);
  EXPECT_TRUE(std::isnan(value(*row, "method2_x_N"))) << "it is not loaded";
  EXPECT_FLOAT_EQ(value(*row, "method0_uncertainty_N"), 0.75);
  EXPECT_TRUE(std::isnan(value(*row, "method1_uncertainty_N"))) << "it can't tell";
  EXPECT_TRUE(std::isnan(value(*row, "method2_uncertainty_N"))) << "it is not loaded";
  EXPECT_FLOAT_EQ(value(*row, "period_max_us"), 2100);
  EXPECT_FLOAT_EQ(value(*row, "wakeup_max_us"), 9);
  EXPECT_FLOAT_EQ(value(*row, "compute_max_us"), 60);
  EXPECT_FLOAT_EQ(value(*row, "report_age_us"), 600);
  EXPECT_FLOAT_EQ(value(*row, "sample_age_ms"), 33.5);
  EXPECT_FLOAT_EQ(value(*row, "energy_mJ"), -2.5);
  EXPECT_FLOAT_EQ(value(*row, "gain"), 0.5);
  EXPECT_FLOAT_EQ(value(*row, "damping_gain"), 0.25);
  EXPECT_FLOAT_EQ(value(*row, "candidate"), 2);
  EXPECT_FLOAT_EQ(value(*row, "reason"), 1);
  EXPECT_FLOAT_EQ(value(*row, "rung"), 4);
  EXPECT_FLOAT_EQ(value(*row, "held_back"), 5);
  EXPECT_FLOAT_EQ(value(*row, "limits"), 7);
  EXPECT_FLOAT_EQ(value(*row, "in_contact"), 1);
  EXPECT_FLOAT_EQ(value(*row, "fault"), 3) << "a fault of any cycle is shown";
  EXPECT_FLOAT_EQ(value(*row, "paused"), 1);
  EXPECT_FLOAT_EQ(value(*row, "rendered_method"), 2);
  EXPECT_FLOAT_EQ(value(*row, "missed_deadlines"), 5);
  EXPECT_FLOAT_EQ(value(*row, "cycle"), 77);
}

TEST(ScopeRows, CountMissedDeadlinesOfTheWholeRun) {
  ScopeRows rows(1);
  FeedCycle cycle = cycle_at(0);
  cycle.missed_deadlines = 2;
  rows.add(cycle);
  cycle.time_ns += kBucket_ns;
  rows.add(cycle);
  const auto row = rows.take_rest();
  ASSERT_TRUE(row);
  EXPECT_EQ(value(*row, "missed_deadlines"), 4.0F);
}

TEST(ScopeRows, SayNothingOfASampleThatNeverCame) {
  ScopeRows rows(1);
  FeedCycle cycle = cycle_at(0);
  cycle.sample_age_ms = -1.0;
  rows.add(cycle);
  EXPECT_TRUE(std::isnan(value(*rows.take_rest(), "sample_age_ms")));
}

// A float has 24 bits: the cycle is exact modulo 2^24, the base of time is a double.
TEST(ScopeRows, StayExactAfterDays) {
  constexpr std::int64_t kFiveDays_ns = std::int64_t{432'000} * 1'000'000'000;
  ScopeRows rows(1);
  rows.add(cycle_at(0));
  FeedCycle cycle = cycle_at(kFiveDays_ns);
  cycle.cycle = (std::uint64_t{25} << 24) + 16'777'213;
  rows.add(cycle);
  const auto row = rows.take_rest();
  ASSERT_TRUE(row);
  EXPECT_EQ(value(*row, "cycle"), 16'777'213.0F);
  EXPECT_DOUBLE_EQ(row->time_s, 432'000.0);
}

TEST(ScopeRows, WithstandAnyNumbers) {
  ScopeRows rows(4);
  FeedCycle cycle;
  cycle.time_ns = std::numeric_limits<std::int64_t>::min();
  cycle.position_W_m.fill(1e300);
  cycle.commanded_force_W_N.fill(-1e300);
  cycle.period_us = std::nan("");
  cycle.energy_to_hand_J = -std::numeric_limits<double>::infinity();
  rows.add(cycle);
  cycle.time_ns = std::numeric_limits<std::int64_t>::max() / 2;
  cycle.period_us = 2000;
  EXPECT_TRUE(rows.add(cycle));
  cycle.time_ns = 0;
  EXPECT_TRUE(rows.add(cycle));
  const auto row = rows.take_rest();
  ASSERT_TRUE(row);
  constexpr float kMost = std::numeric_limits<float>::max();
  EXPECT_EQ(value(*row, "position_x_mm"), kMost);
  EXPECT_EQ(value(*row, "force_x_N"), -kMost);
  EXPECT_EQ(value(*row, "energy_mJ"), -kMost);
  EXPECT_EQ(value(*row, "period_max_us"), 2000.0F);
}

TEST(ScopeMessage, HasTheWorkedBytes) {
  ScopeRow first, second;
  first.time_s = 100.25;
  first.value[1] = 1.5F;
  second.time_s = 100.75;
  second.value[kScopeColumns - 1] = 9.0F;
  const std::vector<ScopeRow> rows = {first, second};
  const auto bytes = scope_message(rows);
  ASSERT_EQ(bytes.size(), 16 + 2 * 47 * 4U);
  const std::vector<std::uint8_t> head(bytes.begin(), bytes.begin() + 16);
  // 100.25 is 0x40591 00000000000.
  const std::vector<std::uint8_t> worked = {1, 0, 2, 0, 47, 0,    0,    0,
                                            0, 0, 0, 0, 0,  0x10, 0x59, 0x40};
  EXPECT_EQ(head, worked);
  std::array<float, 94> numbers{};
  std::memcpy(numbers.data(), bytes.data() + 16, sizeof(numbers));
  EXPECT_EQ(numbers[0], 0.0F);
  EXPECT_EQ(numbers[1], 1.5F);
  EXPECT_EQ(numbers[47], 0.5F) << "time is relative to the base";
  EXPECT_EQ(numbers[93], 9.0F);
}

}  // namespace
}  // namespace forcegrid::view
