// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/w2_firmware.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace forcegrid::emulator {
namespace {

using std::chrono::milliseconds;
using testing::ElementsAreArray;
using Bytes = std::vector<std::uint8_t>;

Bytes hex(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 3) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

rt::TimePoint at(int time_ms) { return rt::TimePoint(milliseconds(time_ms)); }

// The sheet's section 11.6.
const Bytes kKick(14, 0);
const Bytes kCurrents = hex("FB F8 AC 00 4A 01 00 00 00 00 00 00 00 00");
const Bytes kCalibrate = hex("00 00 00 00 00 00 01 00 00 00 00 00 70 17");

class W2FirmwareTest : public testing::Test {
 protected:
  // Configured at 0, the first report collected at 1000 ms: the loop now waits for an OUT report.
  void start() {
    firmware_.set_configured(true, at(0));
    firmware_.run(at(1000));
    ASSERT_TRUE(firmware_.collect_in().has_value());
    firmware_.run(at(1000));
  }
  // One whole exchange; returns the report it released.
  W2Firmware::Report exchange(const Bytes& out, int time_ms) {
    EXPECT_TRUE(firmware_.offer_out(out));
    EXPECT_TRUE(firmware_.run(at(time_ms)));
    const auto in = firmware_.collect_in();
    EXPECT_TRUE(in.has_value());
    return in.value_or(W2Firmware::Report{});
  }

  W2Firmware firmware_{6.0};
};

TEST_F(W2FirmwareTest, FirstReportIsArmedASecondAfterConfiguration) {
  firmware_.run(at(0));
  EXPECT_FALSE(firmware_.in_armed());
  firmware_.set_configured(true, at(5000));
  EXPECT_FALSE(firmware_.run(at(5999)));
  EXPECT_FALSE(firmware_.collect_in().has_value());
  EXPECT_TRUE(firmware_.run(at(6000)));
  EXPECT_TRUE(firmware_.collect_in().has_value());
}

TEST_F(W2FirmwareTest, OneReportComesForOneReport) {
  start();
  for (int ms = 1001; ms < 1020; ++ms) {
    firmware_.run(at(ms));
    EXPECT_FALSE(firmware_.collect_in().has_value()) << "no report without one from the host";
  }
  EXPECT_TRUE(firmware_.offer_out(kKick));
  firmware_.run(at(1020));
  EXPECT_TRUE(firmware_.collect_in().has_value());
  EXPECT_FALSE(firmware_.collect_in().has_value());
}

TEST_F(W2FirmwareTest, UncollectedReportHoldsUpTheLoopAndQueuedReportsAreDrainedToTheLast) {
  firmware_.set_configured(true, at(0));
  firmware_.run(at(1000));
  ASSERT_TRUE(firmware_.in_armed());
  EXPECT_TRUE(firmware_.offer_out(kKick));
  EXPECT_TRUE(firmware_.offer_out(kCurrents));
  EXPECT_FALSE(firmware_.offer_out(kKick)) << "full: NAK";
  firmware_.run(at(1001));
  EXPECT_FALSE(firmware_.outputs().motor_enable) << "acted before its report was collected";
  EXPECT_TRUE(firmware_.collect_in().has_value());
  EXPECT_TRUE(firmware_.run(at(1002)));
  EXPECT_TRUE(firmware_.outputs().motor_enable);
  EXPECT_LT(firmware_.outputs().duty[0], 0.5);
  EXPECT_EQ(firmware_.statistics().reports_drained, 1U);
  EXPECT_EQ(firmware_.statistics().reports_applied, 1U);
  EXPECT_EQ(firmware_.statistics().reports_received, 2U);
}

TEST_F(W2FirmwareTest, ReportBytesAreThoseOfTheSheet) {
  firmware_.set_counters({1000, 2000, 6500, 0, 0, 0});
  start();
  EXPECT_THAT(exchange(kKick, 1001),
              ElementsAreArray(hex("E8 03 D0 07 64 19 00 00 00 00 00 00 00 00")));
  firmware_.set_counters({-1500, 1200, 5200, 0, 0, 0});
  firmware_.press_calibration_button();
  EXPECT_THAT(exchange(kKick, 1002),
              ElementsAreArray(hex("24 FA B0 04 50 14 00 00 00 00 00 00 01 00")));
}

TEST_F(W2FirmwareTest, CurrentsBecomeDuties) {
  start();
  exchange(kCurrents, 1001);  // -1797, 172, 330 mA
  EXPECT_TRUE(firmware_.outputs().motor_enable);
  EXPECT_NEAR(firmware_.outputs().duty[0], 0.5 - 0.4 * 1.797 / 6.0, 1e-12);
  EXPECT_NEAR(firmware_.outputs().duty[1], 0.5 + 0.4 * 0.172 / 6.0, 1e-12);
  EXPECT_NEAR(firmware_.outputs().duty[2], 0.522, 1e-12);
}

TEST(W2Firmware, FullScaleSetsTheDuty) {
  W2Firmware firmware(3.0);
  firmware.set_configured(true, at(0));
  firmware.run(at(1000));
  (void)firmware.collect_in();
  ASSERT_TRUE(firmware.offer_out(kCurrents));
  firmware.run(at(1001));
  EXPECT_NEAR(firmware.outputs().duty[2], 0.544, 1e-12);
}

TEST_F(W2FirmwareTest, CurrentIsNotClamped) {
  start();
  exchange(hex("FF 7F 00 80 00 00 00 00 00 00 00 00 00 00"), 1001);
  EXPECT_NEAR(firmware_.outputs().duty[0], 0.5 + 0.4 * 32.767 / 6.0, 1e-12);
  EXPECT_NEAR(firmware_.outputs().duty[1], 0.5 - 0.4 * 32.768 / 6.0, 1e-12);
}

TEST_F(W2FirmwareTest, WatchdogTripsHalfASecondAfterTheLastValidReport) {
  EXPECT_FALSE(firmware_.watchdog_deadline().has_value());
  start();
  exchange(kCurrents, 2000);
  ASSERT_TRUE(firmware_.watchdog_deadline().has_value());
  EXPECT_EQ(*firmware_.watchdog_deadline(), at(2500));
  EXPECT_FALSE(firmware_.check_watchdog(at(2499)));
  EXPECT_TRUE(firmware_.outputs().motor_enable);
  EXPECT_TRUE(firmware_.check_watchdog(at(2500)));
  EXPECT_FALSE(firmware_.outputs().motor_enable);
  EXPECT_THAT(firmware_.outputs().duty, testing::Each(0.5));
  EXPECT_EQ(firmware_.statistics().watchdog_trips, 1U);
  EXPECT_FALSE(firmware_.check_watchdog(at(9000))) << "trips once";
  exchange(kCurrents, 9001);
  EXPECT_TRUE(firmware_.outputs().motor_enable) << "the next valid report enables at once";
}

TEST_F(W2FirmwareTest, WrongLengthReleasesTheNextReportButFeedsNothing) {
  start();
  exchange(kCurrents, 2000);
  for (const std::size_t size : {0U, 1U, 13U, 15U, 64U}) {
    exchange(Bytes(size, 0x7F), 2300);
    EXPECT_NEAR(firmware_.outputs().duty[2], 0.522, 1e-12) << size << " bytes were acted on";
  }
  EXPECT_EQ(firmware_.statistics().short_reports, 3U);
  EXPECT_EQ(firmware_.statistics().long_reports, 2U);
  EXPECT_TRUE(firmware_.check_watchdog(at(2500)));
}

// W3, sheet sections 2.2 and 3.3: 64 bytes each way, and hosts send noise behind the first 14.
TEST(W3Firmware, ReportsAreTheSameIn64BytesAndWhatFollowsThemIsIgnored) {
  W2Firmware firmware(6.0, 64);
  firmware.set_counters({-1500, 1200, 5200, 0, 0, 0});
  firmware.set_configured(true, at(0));
  EXPECT_TRUE(firmware.run(at(1000)));
  Bytes expected = hex("24 FA B0 04 50 14 00 00 00 00 00 00 00 00");
  expected.resize(64);
  EXPECT_THAT(firmware.in_report(), ElementsAreArray(expected));
  ASSERT_TRUE(firmware.collect_in().has_value());
  Bytes noisy = kCurrents;
  noisy.resize(64, 0xA5);
  EXPECT_TRUE(firmware.offer_out(noisy));
  EXPECT_TRUE(firmware.run(at(1001)));
  EXPECT_TRUE(firmware.outputs().motor_enable);
  EXPECT_NEAR(firmware.outputs().duty[2], 0.522, 1e-12);  // 330 mA of 6 A
  EXPECT_EQ(firmware.statistics().reports_received, 1U);
}

TEST(W6Firmware, DrivesSixMotorsFromReportsOf20BytesAndItsWatchdogEndsAll) {
  W2Firmware firmware(6.0, 20, true);
  firmware.set_configured(true, at(0));
  static_cast<void>(firmware.run(at(0)));
  static_cast<void>(firmware.run(at(1000)));
  ASSERT_TRUE(firmware.collect_in().has_value());
  // 330 mA in motor c; 100, -100 and 1 mA in the wrist's.
  const auto out = hex("00 00 00 00 4A 01 00 00 00 00 00 00 00 00 64 00 9C FF 01 00");
  ASSERT_TRUE(firmware.offer_out(out));
  static_cast<void>(firmware.run(at(1001)));
  const auto& duty = firmware.outputs().duty;
  EXPECT_NEAR(duty[2], 0.522, 1e-12);
  EXPECT_NEAR(duty[3], 0.5 + 0.4 * 0.1 / 6.0, 1e-12);
  EXPECT_NEAR(duty[4], 0.5 - 0.4 * 0.1 / 6.0, 1e-12);
  EXPECT_NEAR(duty[5], 0.5 + 0.4 * 0.001 / 6.0, 1e-12);
  EXPECT_TRUE(firmware.check_watchdog(at(1501)));
  EXPECT_THAT(firmware.outputs().duty, testing::Each(0.5));
  EXPECT_FALSE(firmware.outputs().motor_enable);
}

TEST(W3Firmware, AReportOf14BytesReleasesTheNextButFeedsNothing) {
  W2Firmware firmware(6.0, 64);
  firmware.set_configured(true, at(0));
  EXPECT_TRUE(firmware.run(at(1000)));
  ASSERT_TRUE(firmware.collect_in().has_value());
  EXPECT_TRUE(firmware.offer_out(kCurrents));
  EXPECT_TRUE(firmware.run(at(1001)));
  EXPECT_TRUE(firmware.in_armed());
  EXPECT_FALSE(firmware.outputs().motor_enable);
  EXPECT_EQ(firmware.statistics().short_reports, 1U);
  EXPECT_FALSE(firmware.last_feed().has_value());
}

TEST_F(W2FirmwareTest, CommandOneLoadsCountersAndGivesZeroCurrent) {
  firmware_.set_counters({111, 222, 333, 444, 555, 666});
  firmware_.press_calibration_button();
  start();
  const auto before = exchange(kCurrents, 1001);
  EXPECT_EQ(before[12], 1);
  const auto after = exchange(kCalibrate, 1002);
  EXPECT_THAT(after, ElementsAreArray(hex("00 00 00 00 70 17 00 00 00 00 00 00 00 00")));
  EXPECT_THAT(firmware_.outputs().duty, testing::Each(0.5));
  EXPECT_TRUE(firmware_.outputs().motor_enable);
  EXPECT_EQ(firmware_.statistics().counters_loaded, 1U);
}

TEST_F(W2FirmwareTest, CommandOneLoadsTheGimbalFromTheCurrentFields) {
  start();
  exchange(hex("01 00 FE FF 03 00 01 00 0A 00 0B 00 F4 FF"), 1001);
  EXPECT_THAT(firmware_.counters(), testing::ElementsAre(10, 11, -12, 1, -2, 3));
}

TEST_F(W2FirmwareTest, AddsTenThousandToCounterDWhileTheStylusButtonIsDown) {
  firmware_.set_counters({1, 2, 3, -123, 5, 6});
  start();
  firmware_.hold_stylus_button(true);
  exchange(kKick, 1001);
  // 10000 - 123 = 9877 = 0x2695.
  EXPECT_THAT(exchange(kKick, 1002),
              ElementsAreArray(hex("01 00 02 00 03 00 95 26 05 00 06 00 00 00")));
  firmware_.hold_stylus_button(false);
  exchange(kKick, 1003);
  EXPECT_THAT(exchange(kKick, 1004),
              ElementsAreArray(hex("01 00 02 00 03 00 85 FF 05 00 06 00 00 00")));
  EXPECT_EQ(firmware_.counters()[3], -123);
}

TEST_F(W2FirmwareTest, OtherCommandsApplyTheCurrents) {
  start();
  exchange(hex("00 00 00 00 4A 01 02 00 09 00 09 00 09 00"), 1001);
  EXPECT_NEAR(firmware_.outputs().duty[2], 0.522, 1e-12);
  EXPECT_EQ(firmware_.statistics().counters_loaded, 0U);
}

TEST_F(W2FirmwareTest, InfoStaysUntilCommandOne) {
  start();
  firmware_.press_calibration_button();
  for (int ms = 1001; ms < 1010; ++ms) {
    EXPECT_EQ(exchange(kKick, ms)[12], 1);
  }
  EXPECT_EQ(exchange(kCalibrate, 1010)[12], 0);
}

TEST_F(W2FirmwareTest, CountersCountIn32BitsAndReportTheLow16) {
  firmware_.turn_encoders({0, 0, 0, 0, 0, 0});
  firmware_.turn_encoders({70000, -70000, 32768, 0, 0, 0});
  EXPECT_THAT(firmware_.counters(), testing::ElementsAre(70000, -70000, 32768, 0, 0, 0));
  start();
  const auto report = exchange(kKick, 1001);
  // 70000 - 65536 = 4464 = 0x1170, -70000 + 65536 = -4464 = 0xEE90, 32768 wraps to 0x8000.
  EXPECT_THAT(report, ElementsAreArray(hex("70 11 90 EE 00 80 00 00 00 00 00 00 00 00")));
}

TEST_F(W2FirmwareTest, CountersFollowTheEncodersFromWhateverWasLoaded) {
  firmware_.turn_encoders({5000, 0, 0, 0, 0, 0});
  start();
  exchange(kCalibrate, 1001);
  firmware_.turn_encoders({5010, -3, 2, 0, 0, 0});
  EXPECT_THAT(firmware_.counters(), testing::ElementsAre(10, -3, 6002, 0, 0, 0));
}

TEST_F(W2FirmwareTest, SurvivesABusResetWithItsCountersAndArmsAFreshReportOnReconfiguration) {
  start();
  firmware_.turn_encoders({0, 0, 0, 0, 0, 0});
  exchange(kCalibrate, 1001);
  firmware_.set_configured(false, at(1100));
  EXPECT_FALSE(firmware_.offer_out(kKick)) << "nobody answers on an unconfigured bus";
  firmware_.run(at(1101));
  EXPECT_FALSE(firmware_.collect_in().has_value());
  firmware_.turn_encoders({1, 2, 3, 0, 0, 0});
  firmware_.set_configured(true, at(1200));
  firmware_.run(at(1201));
  const auto report = firmware_.collect_in();
  ASSERT_TRUE(report.has_value()) << "no second start-up time";
  EXPECT_THAT(*report, ElementsAreArray(hex("01 00 02 00 73 17 00 00 00 00 00 00 00 00")));
}

}  // namespace
}  // namespace forcegrid::emulator
