// SPDX-License-Identifier: Apache-2.0
#include "driver/w2_codec.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace forcegrid::driver::w2 {
namespace {

TEST(W2Codec, DecodesTheSheetsInputReports) {
  InputReport report;
  const ReportBytes first = {0xE8, 0x03, 0xD0, 0x07, 0x64, 0x19, 0, 0, 0, 0, 0, 0, 0, 0};
  ASSERT_TRUE(decode(first, report));
  EXPECT_EQ(report.counts, (std::array<std::int16_t, 6>{1000, 2000, 6500, 0, 0, 0}));
  EXPECT_FALSE(report.calibration_button);
  const ReportBytes second = {0x24, 0xFA, 0xB0, 0x04, 0x50, 0x14, 0, 0, 0, 0, 0, 0, 0x01, 0};
  ASSERT_TRUE(decode(second, report));
  EXPECT_EQ(report.counts, (std::array<std::int16_t, 6>{-1500, 1200, 5200, 0, 0, 0}));
  EXPECT_TRUE(report.calibration_button);
}

TEST(W2Codec, DecodesMinusOneAndBothEndsOfTheRange) {
  InputReport report;
  const ReportBytes bytes = {0xFF, 0xFF, 0xFF, 0x7F, 0x00, 0x80, 1, 0, 2, 0, 3, 0, 0, 0};
  ASSERT_TRUE(decode(bytes, report));
  EXPECT_EQ(report.counts, (std::array<std::int16_t, 6>{-1, 32767, -32768, 1, 2, 3}));
}

TEST(W2Codec, TakesTheStylusButtonFromCounterDOfADeviceThatHasOne) {
  // d = 10000 - 123 = 0x2695: pressed, at -123. Then 5000, which is still a count, and 5001.
  const ReportBytes pressed = {0, 0, 0, 0, 0, 0, 0x95, 0x26, 7, 0, 8, 0, 0, 0};
  InputReport report;
  ASSERT_TRUE(decode(pressed, report, kReportBytes, true));
  EXPECT_TRUE(report.stylus_button);
  EXPECT_EQ(report.counts, (std::array<std::int16_t, 6>{0, 0, 0, -123, 7, 8}));
  ASSERT_TRUE(decode(pressed, report));
  EXPECT_FALSE(report.stylus_button) << "another device has no such button";
  EXPECT_EQ(report.counts[3], 9877);
  ASSERT_TRUE(decode(ReportBytes{0, 0, 0, 0, 0, 0, 0x88, 0x13}, report, kReportBytes, true));
  EXPECT_FALSE(report.stylus_button);
  EXPECT_EQ(report.counts[3], 5000);
  ASSERT_TRUE(decode(ReportBytes{0, 0, 0, 0, 0, 0, 0x89, 0x13}, report, kReportBytes, true));
  EXPECT_TRUE(report.stylus_button);
  EXPECT_EQ(report.counts[3], -4999);
}

TEST(W2Codec, RefusesReportsOfAnotherLengthAndLeavesTheOldOne) {
  const std::array<std::uint8_t, 64> bytes{};
  InputReport report;
  report.counts[0] = 77;
  for (std::size_t length = 0; length <= bytes.size(); ++length) {
    if (length != kReportBytes) {
      EXPECT_FALSE(decode({bytes.data(), length}, report)) << length;
    }
  }
  EXPECT_EQ(report.counts[0], 77);
}

TEST(W2Codec, TakesTheFirst14BytesOfAW3ReportAndNoOtherLength) {
  std::array<std::uint8_t, kW3ReportBytes> bytes;
  bytes.fill(0xA5);
  const ReportBytes first = {0x24, 0xFA, 0xB0, 0x04, 0x50, 0x14, 0, 0, 0, 0, 0, 0, 0x01, 0};
  std::copy(first.begin(), first.end(), bytes.begin());
  InputReport report;
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    EXPECT_FALSE(decode({bytes.data(), length}, report, kW3ReportBytes)) << length;
  }
  ASSERT_TRUE(decode(bytes, report, kW3ReportBytes));
  EXPECT_EQ(report.counts, (std::array<std::int16_t, 6>{-1500, 1200, 5200, 0, 0, 0}));
  EXPECT_TRUE(report.calibration_button);
}

TEST(W2Codec, EncodesTheSheetsOutputReports) {
  EXPECT_EQ(encode_currents({-1797, 172, 330}),
            (ReportBytes{0xFB, 0xF8, 0xAC, 0x00, 0x4A, 0x01, 0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(encode_load_counters({0, 0, 6000, 0, 0, 0}),
            (ReportBytes{0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0x70, 0x17}));
  EXPECT_EQ(encode_currents({}), ReportBytes{});
}

TEST(W2Codec, CarriesTheGimbalCountersInTheCurrentFields) {
  EXPECT_EQ(encode_load_counters({1, 2, 3, 4, 5, -1}),
            (ReportBytes{4, 0, 5, 0, 0xFF, 0xFF, 1, 0, 1, 0, 2, 0, 3, 0}));
}

TEST(W2Codec, TruncatesTowardZero) {
  const Currents currents = report_currents({-1.7976, 1.7976, 0.0009}, {6.0, 6.0, 6.0});
  EXPECT_EQ(currents.current_mA, (std::array<std::int16_t, 3>{-1797, 1797, 0}));
  EXPECT_FALSE(currents.clamped);
}

TEST(W2Codec, ClampsBeforeItNarrowsSoThat40AmperesDoNotTurnRound) {
  const Currents currents = report_currents({40.0, -40.0, 1e300}, {6.0, 3.0, 5.0});
  EXPECT_EQ(currents.current_mA, (std::array<std::int16_t, 3>{5999, -2999, 4999}));
  EXPECT_TRUE(currents.clamped);
  EXPECT_TRUE(currents.finite);
  // A limit beyond the field's range must not wrap either.
  EXPECT_EQ(report_currents({100.0, -100.0, 0.0}, {64.0, 64.0, 64.0}).current_mA,
            (std::array<std::int16_t, 3>{32767, -32767, 0}));
}

TEST(W2Codec, SendsNothingWhenAnyCurrentIsNotFinite) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    const Currents currents = report_currents({1.0, bad, 1.0}, {6.0, 6.0, 6.0});
    EXPECT_FALSE(currents.finite);
    EXPECT_EQ(currents.current_mA, (std::array<std::int16_t, 3>{0, 0, 0}));
  }
}

TEST(CounterUnwrapper, FollowsACounterThroughBothWraps) {
  CounterUnwrapper unwrapper;
  std::int32_t reference = 32000;
  for (const std::int32_t step : {0, 700, 100, 20000, 32767, -5, -32768, -32768, -32768, -1}) {
    reference += step;
    const auto low = static_cast<std::int16_t>(static_cast<std::uint16_t>(reference));
    EXPECT_EQ(unwrapper.follow({low, 0, 0, 0, 0, low})[0], reference);
  }
}

TEST(CounterUnwrapper, StartsFromTheFirstReportAndAgainFromRestart) {
  CounterUnwrapper unwrapper;
  EXPECT_EQ(unwrapper.follow({-32768, 0, 0, 0, 0, 0})[0], -32768);
  EXPECT_EQ(unwrapper.follow({32767, 0, 0, 0, 0, 0})[0], -32769);
  unwrapper.restart({100, 0, 6000, 0, 0, 0});
  EXPECT_EQ(unwrapper.follow({101, 0, 5999, 0, 0, 0}),
            (std::array<std::int32_t, 6>{101, 0, 5999, 0, 0, 0}));
}

}  // namespace
}  // namespace forcegrid::driver::w2
