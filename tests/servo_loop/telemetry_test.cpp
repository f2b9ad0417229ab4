// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/telemetry.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

namespace forcegrid::servo {
namespace {

CycleRecord record_at(std::uint64_t cycle) {
  CycleRecord record;
  record.cycle = cycle;
  record.time_ns = static_cast<std::int64_t>(cycle) * 2'000'000;
  record.period_us = 2000.0;
  record.wakeup_us = 50.0;
  record.compute_us = 5.0;
  record.method_force_W_N[0] = {0.0, 0.0, -0.001 * static_cast<double>(cycle)};
  return record;
}

TEST(Telemetry, KeepsTheNewestCyclesAndCountsAll) {
  ServoPorts ports;
  TelemetryOptions options;
  options.keep_cycles = 1000;
  Telemetry telemetry(ports, options);
  telemetry.start();
  for (std::uint64_t i = 0; i < 5000;) {
    if (ports.records.push(record_at(i))) {
      ++i;
    }
  }
  telemetry.stop();
  EXPECT_EQ(telemetry.statistics().cycles, 5000u);
  ASSERT_EQ(telemetry.records().size(), 1000u);
  EXPECT_EQ(telemetry.records().front().cycle, 4000u);
  EXPECT_EQ(telemetry.records().back().cycle, 4999u);
  EXPECT_NEAR(telemetry.statistics().period_us.at(0.5), 2000.0, 2000.0 / 512);
  EXPECT_NEAR(telemetry.statistics().wakeup_us.at(0.5), 50.0, 50.0 / 512);
}

TEST(Telemetry, CountsTheRungsAndSaysWhenTheForceGivesWay) {
  ServoPorts ports;
  TelemetryOptions options;
  std::string sentences;
  options.on_sentence = [&](const std::string& text) { sentences += text + "\n"; };
  Telemetry telemetry(ports, options);
  for (std::uint64_t i = 0; i < 100; ++i) {
    CycleRecord record = record_at(i);
    record.rung = i < 50 ? Rung::kFresh : (i < 70 ? Rung::kOld : Rung::kDamping);
    record.held_back = i < 70 ? HeldBack::kNot : HeldBack::kNoSamples;
    ASSERT_TRUE(ports.records.push(record));
  }
  telemetry.start();
  telemetry.stop();
  const TelemetryStatistics& statistics = telemetry.statistics();
  EXPECT_EQ(statistics.rung_cycles, (std::array<std::uint64_t, kRungs>{50, 20, 30, 0}));
  EXPECT_EQ(statistics.rung_changes, 3u);  // the first is from zero current
  ASSERT_EQ(statistics.first_rung_changes.size(), 3u);
  EXPECT_EQ(statistics.first_rung_changes[2].to, Rung::kDamping);
  EXPECT_DOUBLE_EQ(statistics.first_rung_changes[2].time_s, 0.14);
  const std::string gives_way =
      "    0.1 s  The force gives way to a damping field: no sample comes from the simulator.\n";
  EXPECT_EQ(sentences, "    0.0 s  Samples come; the force ramps in.\n" + gives_way);
}

TEST(Telemetry, TellsWhoOfTheRenderedMethodsMembersWasFeltAndWhenItChanged) {
  ServoPorts ports;
  Telemetry telemetry(ports, {});
  for (std::uint64_t i = 0; i < 100; ++i) {
    CycleRecord record = record_at(i);
    record.in_contact = i >= 10;
    record.rendered_candidate = i < 60 ? 0 : 3;
    record.rendered_reason = i < 60 ? ChoiceReason::kFirst : ChoiceReason::kPredictedBetter;
    record.method_uncertainty_N[0] = 0.02;
    ASSERT_TRUE(ports.records.push(record));
  }
  telemetry.start();
  telemetry.stop();
  const TelemetryStatistics& statistics = telemetry.statistics();
  EXPECT_EQ(statistics.rendered_candidate[0], 50u);
  EXPECT_EQ(statistics.rendered_candidate[3], 40u);
  EXPECT_EQ(statistics.candidate_changes, 1u);
  ASSERT_EQ(statistics.first_changes.size(), 1u);
  EXPECT_DOUBLE_EQ(statistics.first_changes[0].time_s, 0.12);
  EXPECT_EQ(statistics.first_changes[0].from, 0);
  EXPECT_EQ(statistics.first_changes[0].to, 3);
  EXPECT_EQ(statistics.first_changes[0].reason, ChoiceReason::kPredictedBetter);
  EXPECT_EQ(statistics.uncertainty_mN.count(), 90u);
  EXPECT_NEAR(statistics.uncertainty_mN.at(0.5), 20.0, 20.0 / 512);
}

TEST(Telemetry, WritesTheLastFiveSecondsAsAFlightRecord) {
  ServoPorts ports;
  TelemetryOptions options;
  options.method_names = {"forcegrid"};
  Telemetry telemetry(ports, options);
  for (std::uint64_t i = 0; i < 4000; ++i) {
    CycleRecord record = record_at(i);
    record.fault = i == 3999 ? Fault::kUnplugged : Fault::kNone;
    ASSERT_TRUE(ports.records.push(record));
  }
  telemetry.start();
  telemetry.stop();
  const std::string path = ::testing::TempDir() + "flight_record_test.csv";
  telemetry.write_flight_record(path);
  std::ifstream file(path);
  std::string header;
  std::getline(file, header);
  EXPECT_EQ(header.rfind("time_s,cycle,", 0), 0u);
  const auto columns = std::count(header.begin(), header.end(), ',');
  int rows = 0;
  std::string line;
  std::string last;
  while (std::getline(file, line)) {
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), columns);
    last = line;
    ++rows;
  }
  EXPECT_EQ(rows, 2501);  // 5 s of 2 ms cycles, both ends
  EXPECT_NE(last.find("unplugged"), std::string::npos);
}

TEST(Telemetry, GoesOnWithoutACallbackThatThrew) {
  ServoPorts ports;
  TelemetryOptions options;
  int calls = 0;
  options.on_cycle = [&](const CycleRecord& record) {
    ++calls;
    if (record.cycle == 10) {
      throw std::runtime_error("the disk is gone");
    }
  };
  Telemetry telemetry(ports, options);
  for (std::uint64_t i = 0; i < 100; ++i) {
    ASSERT_TRUE(ports.records.push(record_at(i)));
  }
  telemetry.start();
  telemetry.stop();
  EXPECT_EQ(telemetry.trouble(), "the disk is gone");
  EXPECT_EQ(calls, 11);
  EXPECT_EQ(telemetry.statistics().cycles, 100u);  // the flight record has them all
  EXPECT_EQ(telemetry.records().size(), 100u);
}

TEST(Telemetry, TellsWhenADrainIsOver) {
  ServoPorts ports;
  TelemetryOptions options;
  std::vector<std::uint64_t> told;
  int drains = 0;
  options.on_cycle = [&](const CycleRecord& record) { told.push_back(record.cycle); };
  options.on_drained = [&] {
    ++drains;
    EXPECT_EQ(told.size(), 3u) << "behind the last of the cycles that wait";
  };
  Telemetry telemetry(ports, options);
  for (std::uint64_t i = 0; i < 3; ++i) {
    ASSERT_TRUE(ports.records.push(record_at(i)));
  }
  telemetry.start();
  telemetry.stop();
  EXPECT_EQ(drains, 1) << "a drain without a cycle tells nothing";
}

// A loop of 2 ms whose newest cycle began at 100 ms, 30 us behind its deadline, and took 150 us.
TEST(Telemetry, DrainsWhileTheLoopSleeps) {
  using namespace std::chrono_literals;
  const auto at = [](std::chrono::nanoseconds since) { return rt::TimePoint(since); };
  CycleRecord newest;
  newest.time_ns = 100'030'000;
  newest.compute_us = 150.0;
  const auto next = [&](std::chrono::nanoseconds now, std::chrono::milliseconds interval) {
    return Telemetry::next_drain(at(now), &newest, interval, 500.0);
  };
  // An eighth of a period behind the end of a cycle: 430 us behind one of the deadlines.
  EXPECT_EQ(next(100'200us, 5ms), at(106'430us));
  EXPECT_EQ(next(100'430us, 4ms), at(104'430us)) << "not before the interval, and no period later";
  EXPECT_EQ(next(100'431us, 4ms), at(106'430us));
  EXPECT_EQ(Telemetry::next_drain(at(7ms), nullptr, 5ms, 500.0), at(12ms)) << "no cycle yet";
  // A loop that has ended long ago: still at most one period beside the interval.
  const auto late = next(10s, 5ms);
  EXPECT_GE(late, at(10'005ms));
  EXPECT_LT(late, at(10'007ms));
}

TEST(Telemetry, SaysWhichFlightRecordCouldNotBeWritten) {
  ServoPorts ports;
  Telemetry telemetry(ports, {});
  try {
    telemetry.write_flight_record("/nonexistent-folder/flight.csv");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/nonexistent-folder/flight.csv"), std::string::npos);
  }
}

}  // namespace
}  // namespace forcegrid::servo
