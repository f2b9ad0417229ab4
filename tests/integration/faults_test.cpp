// SPDX-License-Identifier: Apache-2.0
// Each fault of the emulated device through bytes, driver and servo loop: what is it called, and
// when are the motors without current? By the emulator's own record of its currents.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>
#include <string>

#include "driver/device.h"
#include "rt/vectors.h"
#include "tests/integration/fault_bench.h"

namespace forcegrid {
namespace {

using emulator::MotionKind;
using servo::Fault;
using std::chrono::milliseconds;
using testing::Endured;
using testing::expect_endured;
using testing::expect_seen;
using testing::FaultBench;
using testing::FaultyRun;
using testing::is_off;
using testing::kReaction_ms;
using testing::pushed;

constexpr double kWatchdog_ms = 500.0;
// The watchdog counts from the last report that it took, which may be some frames before the cycle.
constexpr double kWatchdogSlack_ms = 30.0;

// Time enough for the motors to push for half a second, and for any fault to be seen.
constexpr double kLongest_s = 10.0;

// --- Faults that end the loop while the way to the motors is still open. ---

struct Stop {
  const char* test;
  const char* fault;
  Fault expected;
  /// [ms] until the first cycle that can see it, by docs/faults.md; beyond it 20 ms.
  double visible_after_ms;
};

class FaultWithAnOpenChannel : public ::testing::TestWithParam<Stop> {};

TEST_P(FaultWithAnOpenChannel, IsNamedAndTheMotorsGetZeroWithinTwentyMilliseconds) {
  const Stop& stop = GetParam();
  const FaultyRun run = FaultBench(stop.fault).run(kLongest_s);
  ASSERT_FALSE(run.records.empty());
  ASSERT_TRUE(pushed(run)) << servo::name_of(run.outcome.fault) << ": "
                           << run.outcome.device_failure;
  EXPECT_EQ(run.outcome.fault, stop.expected)
      << servo::name_of(run.outcome.fault) << ": " << run.outcome.device_failure;
  EXPECT_EQ(run.last().fault, stop.expected);
  EXPECT_EQ(run.last().current_A, (servo::Triple{}));
  expect_seen(run, stop.fault, stop.visible_after_ms);
  EXPECT_LE(run.motors_off_after_ms(), kReaction_ms + run.held_up_ms);
  EXPECT_EQ(run.emulator.watchdog_trips, 0u);
}

INSTANTIATE_TEST_SUITE_P(
    Faults, FaultWithAnOpenChannel,
    ::testing::Values(
        Stop{"LateByHalfASecond", "late-report:ms=500", Fault::kStaleReports, 140.0},
        // Half of the time is allowed to be late; being late all the time uses a
        // quarter of a second up in half a second, and a report is 50 ms.
        Stop{"LateByFiftyMilliseconds", "late-report:ms=50", Fault::kLateReports, 700.0},
        Stop{"LateByThirtyMilliseconds", "late-report:ms=30", Fault::kLateReports, 700.0},
        Stop{"LateByFortyMilliseconds", "late-report:ms=40", Fault::kLateReports, 700.0},
        Stop{"TooShort", "short-report", Fault::kProtocol, 60.0},
        Stop{"TooLong", "long-report", Fault::kProtocol, 60.0},
        Stop{"Corrupt", "corrupt-report", Fault::kImplausibleJump, 0.0},
        Stop{"EncoderJumps", "jumping-encoder", Fault::kImplausibleJump, 0.0},
        Stop{"EncoderSaturates", "saturated-encoder", Fault::kSaturatedEncoder, 0.0},
        // The patience with a joint that has just been suspected is a second.
        Stop{"EncodersFreeze", "frozen-encoder", Fault::kFrozenEncoder, 1160.0}),
    [](const auto& test) { return test.param.test; });

TEST(EncoderOfAPhantom, HasJumpedByFiveHundredCounts) {
  // 85 mrad, or 11 mm in one cycle.
  for (const char* axis : {"a", "b", "c"}) {
    const FaultyRun run = FaultBench(std::string("jumping-encoder:counts=500,axis=") + axis,
                                     emulator::MotionKind::kLissajous, "phantom_desktop")
                              .run(kLongest_s);
    ASSERT_TRUE(pushed(run));
    EXPECT_EQ(run.outcome.fault, Fault::kImplausibleJump) << servo::name_of(run.outcome.fault);
    EXPECT_NE(servo::sentence_for(run.outcome.fault, run.outcome.joint)
                  .find(std::string("joint ") + axis),
              std::string::npos);
    expect_seen(run, axis, 0.0);
    EXPECT_LE(run.motors_off_after_ms(), kReaction_ms + run.held_up_ms);
  }
}

TEST(CounterOfFewBits, IsAJumpWhenItWraps) {
  // Eight bits are 128 counts, or some 8 mm; sixteen millimetres are missing then.
  const FaultyRun run = FaultBench("wrapping-encoder:bits=8,when=0").run(kLongest_s);
  EXPECT_EQ(run.outcome.fault, Fault::kImplausibleJump) << servo::name_of(run.outcome.fault);
  EXPECT_LE(run.motors_off_after_ms(), kReaction_ms + run.held_up_ms);
  EXPECT_TRUE(is_off(run));
}

TEST(OverLongPayload, EndsTheConnectionAfterALastZero) {
  const FaultyRun run = FaultBench("over-long-payload").run(kLongest_s);
  ASSERT_TRUE(pushed(run));
  EXPECT_EQ(run.outcome.fault, Fault::kProtocol);
  EXPECT_NE(run.outcome.device_failure.find("128 bytes where at most 64"), std::string::npos)
      << run.outcome.device_failure;
  // The zero can't be confirmed, but it arrives; the watchdog would take half a second.
  EXPECT_FALSE(run.outcome.zero_current_delivered);
  EXPECT_LE(run.motors_off_after_ms(), kReaction_ms + run.held_up_ms);
  EXPECT_TRUE(is_off(run));
}

// --- Faults that close the way to the motors: the device's own watchdog ends the current. ---

class FaultWithAClosedChannel : public ::testing::TestWithParam<Stop> {};

TEST_P(FaultWithAClosedChannel, IsNamedAndTheWatchdogStopsTheMotors) {
  const Stop& stop = GetParam();
  const FaultyRun run = FaultBench(stop.fault).run(kLongest_s, false, milliseconds(700));
  ASSERT_TRUE(pushed(run));
  EXPECT_EQ(run.outcome.fault, stop.expected)
      << servo::name_of(run.outcome.fault) << ": " << run.outcome.device_failure;
  EXPECT_FALSE(run.outcome.zero_current_delivered);
  expect_seen(run, stop.fault, stop.visible_after_ms);
  EXPECT_LE(run.motors_off_after_ms(), kWatchdog_ms + kWatchdogSlack_ms + run.held_up_ms);
}

INSTANTIATE_TEST_SUITE_P(
    Faults, FaultWithAClosedChannel,
    ::testing::Values(Stop{"StallOnOut", "stall-out", Fault::kProtocol, 0.0},
                      // A W2 firmware whose report is not collected looks at no OUT any more.
                      Stop{"StallOnIn", "stall-in", Fault::kProtocol, 0.0},
                      Stop{"Babble", "babble", Fault::kProtocol, 0.0},
                      // Reports end with the OUTs that release them, and silence takes 100 ms.
                      Stop{"NakForEverOnOut", "nak-out", Fault::kStaleReports, 140.0},
                      Stop{"FirmwareReboots", "firmware-reboot", Fault::kUnplugged, 0.0},
                      Stop{"ConnectionCloses", "connection-closed", Fault::kUnplugged, 0.0}),
    [](const auto& test) { return test.param.test; });

// --- Faults that the loop lives with, and counts. ---

class EnduredFault : public ::testing::TestWithParam<Endured> {};

TEST_P(EnduredFault, IsCountedAndTheLoopGoesOn) {
  const FaultyRun run = FaultBench(GetParam().fault).run(1.6);
  expect_endured(run, GetParam());
  EXPECT_EQ(run.emulator.watchdog_trips, 0u);
}

INSTANTIATE_TEST_SUITE_P(
    Faults, EnduredFault,
    ::testing::Values(
        Endured{"DroppedReports", "drop-report", &driver::DeviceStatistics::reports_lost},
        Endured{"DroppedReportsAtRandom", "drop-report:every=1,probability=0.005,seed=3",
                &driver::DeviceStatistics::reports_lost},
        Endured{"DuplicatedReports", "duplicate-report",
                &driver::DeviceStatistics::reports_drained},
        Endured{"ReportsLateByFiveMilliseconds", "late-report:ms=5",
                &driver::DeviceStatistics::reports_late},
        Endured{"OneReportLateByFiftyMilliseconds", "late-report:ms=50,count=1",
                &driver::DeviceStatistics::reports_lost},
        Endured{"ShortReportsNowAndThen", "short-report:every=50",
                &driver::DeviceStatistics::reports_rejected},
        Endured{"LongReportsNowAndThen", "long-report:every=50",
                &driver::DeviceStatistics::reports_rejected},
        Endured{"FirmwareSlowByTwentyMilliseconds", "slow-firmware:ms=20",
                &driver::DeviceStatistics::reports_late},
        Endured{"CounterOfSixteenBits", "wrapping-encoder:when=power-up", nullptr}),
    [](const auto& test) { return test.param.test; });

TEST(SmallCorruption, ChangesTheForceByNoMoreThanItsCountsAreWorth) {
  const FaultyRun run = FaultBench("corrupt-report:size=small").run(1.6);
  EXPECT_EQ(run.outcome.fault, Fault::kNone) << servo::name_of(run.outcome.fault);
  EXPECT_GE(run.emulator.faults.at(0).times, 100u);
  // Three counts of at most 0.08 mm on each axis, against 60 N/m of spring.
  constexpr double kCount_m = 0.00008;
  constexpr double kBound_N = 60.0 * 3.0 * kCount_m * std::numbers::sqrt3 * 2.0;
  double largest_step_N = 0.0;
  for (std::size_t i = 1; i < run.records.size(); ++i) {
    const auto& now = run.records[i];
    const auto& before = run.records[i - 1];
    if (now.gain < 1.0 || before.gain < 1.0 || now.period_us > 4000.0) {
      continue;
    }
    largest_step_N = std::max(largest_step_N, (rt::to_vector(now.method_force_W_N[0]) -
                                               rt::to_vector(before.method_force_W_N[0]))
                                                  .norm());
  }
  // What the hand moves between two cycles, at most 0.25 m/s for 4 ms, comes on top.
  EXPECT_LE(largest_step_N, kBound_N + 60.0 * 0.25 * 0.004);
}

TEST(WrapOf16Bits, IsUnwrappedWhereAnArmWithFineEncodersCrossesIt) {
  // Encoders 12.8 times as fine put the middle of the workspace at 32448 counts on axis c, 319
  // below the wrap; the hand's first move, 10 mm up, is some 2200.
  FaultBench bench("wrapping-encoder:when=power-up");
  profiles::DeviceProfile& profile = bench.options().profile;
  profile.kinematics.encoder_counts_per_turn = {25600, 25600, 25600};
  profile.calibration.pose_counts = {0, 16806, 32448, 0, 0, 0};
  const FaultyRun run = bench.run(3.0);
  EXPECT_EQ(run.outcome.fault, Fault::kNone)
      << servo::name_of(run.outcome.fault) << ": " << run.outcome.device_failure;
  std::int32_t largest = 0;
  for (const auto& record : run.records) {
    largest = std::max(largest, record.counts[2]);
  }
  EXPECT_GT(largest, 32767);
  // They are the emulator's own 32-bit ones, but for what the hand has moved since; a wrap that was
  // missed would make 65536.
  EXPECT_NEAR(run.last().counts[2], run.emulator.counters[2], 5000.0);
}

TEST(SlowFirmware, IsNamedAndTheMotorsStopWhenItLooksOrItsWatchdogTrips) {
  const FaultyRun run =
      FaultBench("slow-firmware:ms=300").run(kLongest_s, false, milliseconds(700));
  ASSERT_TRUE(pushed(run));
  EXPECT_EQ(run.outcome.fault, Fault::kStaleReports) << servo::name_of(run.outcome.fault);
  EXPECT_LE(run.seen_after_ms(), 140.0 + kReaction_ms + run.held_up_ms);
  EXPECT_LE(run.motors_off_after_ms(), kWatchdog_ms + kWatchdogSlack_ms + run.held_up_ms);
  EXPECT_TRUE(is_off(run));
}

TEST(WatchdogTrip, TakesTheCurrentAwayAndIsFoundByTheJointThatStandsStill) {
  // The hand pauses three seconds after it has met a host; then a motor that has no current any
  // more moves nothing when its torque is removed.
  const FaultyRun run = FaultBench("watchdog-trip").run(kLongest_s);
  ASSERT_TRUE(pushed(run));
  EXPECT_EQ(run.outcome.fault, Fault::kFrozenEncoder) << servo::name_of(run.outcome.fault);
  EXPECT_GE(run.emulator.watchdog_trips, 1u);
  EXPECT_TRUE(is_off(run));
  ASSERT_TRUE(run.emulator.faults.at(0).seconds_until_motors_off);
  EXPECT_NEAR(*run.emulator.faults.at(0).seconds_until_motors_off, 0.5,
              0.02 + 1e-3 * run.held_up_ms);
}

TEST(WrongWayMotor, IsFoundByAPushBeforeAnyForceIsRendered) {
  const FaultyRun run = FaultBench("wrong-way-motor:axis=b").run(kLongest_s, true);
  testing::expect_wrong_way_motor(run);
  EXPECT_NE(servo::sentence_for(run.outcome.fault, run.outcome.joint).find("joint b"),
            std::string::npos);
  EXPECT_LE(run.motors_off_after_ms(), kReaction_ms + run.held_up_ms);
}

/// All six currents, of a device whose wrist has motors.
bool all_off(const FaultyRun& run) {
  return is_off(run) && run.emulator.wrist &&
         run.emulator.wrist->final_current_mA == std::array<double, 3>{};
}

FaultyRun run_6dof(const char* fault, double seconds) {
  return FaultBench(fault, emulator::MotionKind::kLissajous, "emulated_6dof").run(seconds, true);
}

TEST(WrongWayMotor, OfAWristIsFoundByAPushBeforeAnyForceIsRendered) {
  const FaultyRun run = run_6dof("wrong-way-motor:axis=e", kLongest_s);
  EXPECT_EQ(run.outcome.fault, Fault::kMotorWrongWay) << servo::name_of(run.outcome.fault);
  EXPECT_EQ(run.outcome.joint, 4);
  EXPECT_NE(servo::sentence_for(run.outcome.fault, run.outcome.joint).find("joint e"),
            std::string::npos);
  EXPECT_TRUE(run.outcome.zero_current_delivered);
  for (const auto& record : run.records) {
    EXPECT_EQ(record.gain, 0.0);
  }
  EXPECT_GT(run.emulator.wrist->max_abs_current_mA[1], 100.0) << "it was pushed";
  EXPECT_TRUE(all_off(run));
  EXPECT_LE(run.motors_off_after_ms(), kReaction_ms + run.held_up_ms);
}

TEST(DeadEncoder, OfAWristIsFoundByAPushBeforeAnyForceIsRendered) {
  const FaultyRun run = run_6dof("frozen-encoder:axis=f,when=power-up", kLongest_s);
  EXPECT_EQ(run.outcome.fault, Fault::kMotorNoAnswer) << servo::name_of(run.outcome.fault);
  EXPECT_EQ(run.outcome.joint, 5);
  for (const auto& record : run.records) {
    EXPECT_EQ(record.gain, 0.0);
  }
  EXPECT_TRUE(all_off(run));
}

TEST(SixMotors, PassTheirCheckAndAForceFollows) {
  const FaultyRun run = run_6dof("", 4.0);
  EXPECT_EQ(run.outcome.fault, Fault::kNone) << servo::name_of(run.outcome.fault);
  EXPECT_GT(run.last().gain, 0.5);
  for (const double most_mA : run.emulator.wrist->max_abs_current_mA) {
    EXPECT_GT(most_mA, 200.0) << "each was pushed";
  }
  EXPECT_TRUE(all_off(run));
}

TEST(StallOnControl, IsRefusedWhenTheDeviceIsOpened) {
  try {
    FaultBench("stall-control").run(1.0);
    FAIL() << "opened";
  } catch (const driver::DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("refuses its device descriptor"), std::string::npos)
        << error.what();
  }
}

}  // namespace
}  // namespace forcegrid
