// SPDX-License-Identifier: Apache-2.0
#include "driver/ftdi_port.h"

#include <gtest/gtest.h>

#include <vector>

namespace forcegrid::driver::ftdi {
namespace {

TEST(FtdiDivisor, HasTheSheetsCodes) {
  const struct {
    double divisor;
    std::uint16_t value, index;
    double baud;
  } rows[] = {
      {312.5, 0x4138, 0, 9600.0},        // the boot loader's greeting
      {21.0, 0x0015, 0, 142857.142857},  // its download
      {2.0, 0x0002, 0, 1500000.0},       // the firmware's packets
      {1.0, 0x0000, 0, 3000000.0},       // the two special ones
      {1.5, 0x0001, 0, 2000000.0},
  };
  for (const auto& row : rows) {
    EXPECT_EQ(encode_divisor(row.divisor).value, row.value) << row.divisor;
    EXPECT_EQ(encode_divisor(row.divisor).index, row.index) << row.divisor;
    EXPECT_NEAR(baud_of(row.divisor), row.baud, 1e-6 * row.baud);
  }
}

TEST(FtdiDivisor, CodesEveryEighth) {
  // Bits 14 and 15 of the value and bit 0 of the index, lowest first, as the sheet lists them.
  const struct {
    double fraction;
    unsigned code;
  } rows[] = {{0.0, 0b000},   {0.5, 0b001},   {0.25, 0b010}, {0.125, 0b011},
              {0.375, 0b100}, {0.625, 0b101}, {0.75, 0b110}, {0.875, 0b111}};
  for (const auto& row : rows) {
    const Divisor divisor = encode_divisor(100.0 + row.fraction);
    EXPECT_EQ(divisor.value & 0x3FFF, 100) << row.fraction;
    EXPECT_EQ((divisor.value >> 14) | (divisor.index << 2), static_cast<int>(row.code))
        << row.fraction;
  }
}

TEST(FtdiDivisor, IsTheNearestThatThereIs) {
  EXPECT_EQ(encode_divisor(1.9).value, 2);
  EXPECT_EQ(encode_divisor(1.6).value, 1);
  EXPECT_EQ(encode_divisor(1.1).value, 0);
  EXPECT_EQ(encode_divisor(20000.0).value & 0x3FFF, 16383);
}

TEST(FtdiStatus, IsStrippedFromEveryPacketOfATransfer) {
  // Two full packets of 64 bytes and a short one in one transfer.
  std::vector<std::uint8_t> transfer, expected;
  for (const int size : {62, 62, 5}) {
    transfer.push_back(0x01);
    transfer.push_back(0x60);
    for (int i = 0; i < size; ++i) {
      const auto byte = static_cast<std::uint8_t>(expected.size() * 7);
      transfer.push_back(byte);
      expected.push_back(byte);
    }
  }
  const Stripped stripped = strip_status(transfer, 64);
  EXPECT_TRUE(stripped.whole);
  EXPECT_EQ(stripped.line_errors, 0);
  ASSERT_EQ(stripped.bytes, expected.size());
  transfer.resize(stripped.bytes);
  EXPECT_EQ(transfer, expected);
}

TEST(FtdiStatus, AloneLeavesNoData) {
  std::vector<std::uint8_t> transfer = {0x01, 0x60};
  EXPECT_EQ(strip_status(transfer, 64).bytes, 0U);
  EXPECT_TRUE(strip_status(transfer, 64).whole);
}

TEST(FtdiStatus, MustBeWhole) {
  std::vector<std::uint8_t> one = {0x01};
  EXPECT_FALSE(strip_status(one, 64).whole);
  EXPECT_FALSE(strip_status({}, 64).whole);
  std::vector<std::uint8_t> second_cut(65, 0x01);
  EXPECT_FALSE(strip_status(second_cut, 64).whole);
}

TEST(FtdiStatus, TellsLineErrors) {
  std::vector<std::uint8_t> transfer = {0x01, 0x62, 0x55};  // overrun
  EXPECT_EQ(strip_status(transfer, 64).line_errors, 0x02);
}

}  // namespace
}  // namespace forcegrid::driver::ftdi
