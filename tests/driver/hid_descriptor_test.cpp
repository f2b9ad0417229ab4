// SPDX-License-Identifier: Apache-2.0
#include "driver/hid_descriptor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

using Bytes = std::vector<std::uint8_t>;
using testing::HasSubstr;

/// The sheet's report descriptor of W2 (14) and W1 (8).
Bytes mbed_descriptor(std::uint8_t count) {
  return {0x06, 0xAB,  0xFF, 0x0A, 0x00, 0x02, 0xA1, 0x01,  0x75, 0x08, 0x15, 0x00, 0x25, 0xFF,
          0x95, count, 0x09, 0x01, 0x81, 0x02, 0x95, count, 0x09, 0x02, 0x91, 0x02, 0xC0};
}

std::string error_of(const Bytes& bytes) {
  try {
    static_cast<void>(parse_hid_descriptor(bytes));
  } catch (const DeviceError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(HidDescriptor, ReadsTheSheetsW2AndW1Descriptors) {
  for (const std::uint8_t count : {std::uint8_t{14}, std::uint8_t{8}}) {
    const HidInterface interface = parse_hid_descriptor(mbed_descriptor(count));
    EXPECT_EQ(interface.usage_page, 0xFFAB);
    EXPECT_EQ(interface.usage, 0x0200);
    EXPECT_EQ(interface.input_bytes, count);
    EXPECT_EQ(interface.output_bytes, count);
    EXPECT_EQ(interface.feature_bytes, 0U);
    EXPECT_FALSE(interface.has_report_ids);
  }
}

TEST(HidDescriptor, ReadsTheTeensyDescriptorOfTheSheet) {
  const Bytes bytes = {0x06, 0xAB, 0xFF, 0x0A, 0x00, 0x02, 0xA1, 0x01, 0x75, 0x08,
                       0x15, 0x00, 0x26, 0xFF, 0x00, 0x95, 0x40, 0x09, 0x01, 0x81,
                       0x02, 0x95, 0x40, 0x09, 0x02, 0x91, 0x02, 0xC0};
  const HidInterface interface = parse_hid_descriptor(bytes);
  EXPECT_EQ(interface.usage_page, 0xFFAB);
  EXPECT_EQ(interface.input_bytes, 64U);
  EXPECT_EQ(interface.output_bytes, 64U);
}

TEST(HidDescriptor, ReadsABootMouse) {
  // HID 1.11, appendix E.10: three buttons, five bits of padding, x and y.
  const Bytes bytes = {0x05, 0x01, 0x09, 0x02, 0xA1, 0x01, 0x09, 0x01, 0xA1, 0x00, 0x05, 0x09, 0x19,
                       0x01, 0x29, 0x03, 0x15, 0x00, 0x25, 0x01, 0x95, 0x03, 0x75, 0x01, 0x81, 0x02,
                       0x95, 0x01, 0x75, 0x05, 0x81, 0x01, 0x05, 0x01, 0x09, 0x30, 0x09, 0x31, 0x15,
                       0x81, 0x25, 0x7F, 0x75, 0x08, 0x95, 0x02, 0x81, 0x06, 0xC0, 0xC0};
  const HidInterface interface = parse_hid_descriptor(bytes);
  EXPECT_EQ(interface.usage_page, 0x01);
  EXPECT_EQ(interface.usage, 0x02);
  EXPECT_EQ(interface.input_bytes, 3U);
  EXPECT_EQ(interface.output_bytes, 0U);
}

TEST(HidDescriptor, SeesReportIds) {
  Bytes bytes = mbed_descriptor(14);
  bytes.insert(bytes.begin() + 8, {0x85, 0x01});
  EXPECT_TRUE(parse_hid_descriptor(bytes).has_report_ids);
}

TEST(HidDescriptor, RefusesTheDescriptorCutAnywhere) {
  const Bytes whole = mbed_descriptor(14);
  for (std::size_t length = 0; length < whole.size(); ++length) {
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length));
    EXPECT_THAT(error_of(cut), HasSubstr("HID report descriptor")) << length;
  }
}

TEST(HidDescriptor, NamesTheByteOfWhatIsWrong) {
  Bytes bytes = mbed_descriptor(14);
  bytes.push_back(0xC0);
  EXPECT_THAT(error_of(bytes), HasSubstr("byte 27: the end of a collection that was not begun"));
  EXPECT_THAT(error_of({0x75, 0x08, 0x95, 0x01, 0x81, 0x02}), HasSubstr("outside any collection"));
  EXPECT_THAT(error_of({0xFE, 0x00, 0x00}), HasSubstr("byte 0: a long item"));
  EXPECT_THAT(error_of({0xB4}), HasSubstr("a pop without a push"));
  EXPECT_THAT(error_of({0x0C}), HasSubstr("reserved item type"));
  EXPECT_THAT(error_of({0xA1, 0x01, 0xC0}), HasSubstr("without a usage"));
  EXPECT_THAT(
      error_of({0x05, 0x01, 0x09, 0x02, 0xA1, 0x01, 0x75, 0x01, 0x95, 0x03, 0x81, 0x02, 0xC0}),
      HasSubstr("no whole number of bytes"));
}

TEST(HidDescriptor, BoundsReportsThatWouldBeAbsurdlyLong) {
  // Report size and count of 2^32 - 1 each.
  EXPECT_THAT(error_of({0x05, 0x01, 0x09, 0x02, 0xA1, 0x01, 0x77, 0xFF, 0xFF, 0xFF, 0xFF, 0x97,
                        0xFF, 0xFF, 0xFF, 0xFF, 0x81, 0x02, 0xC0}),
              HasSubstr("more than 4096 bytes"));
}

TEST(HidDescriptor, EndsWithAnAnswerOrAnErrorForAnyBytes) {
  constexpr unsigned kSeed = 4711;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  int accepted = 0;
  for (int i = 0; i < 20000; ++i) {
    Bytes bytes = mbed_descriptor(14);
    for (int edits = 0; edits < 1 + i % 4; ++edits) {
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    }
    try {
      const HidInterface interface = parse_hid_descriptor(bytes);
      EXPECT_LE(interface.input_bytes, 4096U);
      ++accepted;
    } catch (const DeviceError&) {
    }
  }
  EXPECT_GT(accepted, 0);
  EXPECT_LT(accepted, 20000);
}

}  // namespace
}  // namespace forcegrid::driver
