// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/w2_usb_device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace forcegrid::emulator {
namespace {

using Bytes = std::vector<std::uint8_t>;
using testing::ElementsAreArray;

Bytes hex(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 3) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

// The sheet's section 2.1, byte for byte.
const Bytes kDevice = hex("12 01 00 02 00 00 00 40 34 12 06 00 01 00 01 02 03 01");
const Bytes kConfiguration =
    hex("09 02 29 00 01 01 00 C0 00 "
        "09 04 00 00 02 03 00 00 00 "
        "09 21 11 01 00 01 22 1B 00 "
        "07 05 81 03 40 00 01 "
        "07 05 01 03 40 00 01");
const Bytes kReport =
    hex("06 AB FF 0A 00 02 A1 01 75 08 15 00 25 FF 95 0E 09 01 81 02 95 0E 09 02 91 02 C0");

class W2UsbDeviceTest : public testing::Test {
 protected:
  ControlReply request(std::uint8_t type, std::uint8_t request, std::uint16_t value,
                       std::uint16_t index, std::uint16_t length, const Bytes& data = {}) {
    return device_.control({type, request, value, index, length}, data);
  }
  void expect_data(const ControlReply& reply, const Bytes& expected) {
    EXPECT_FALSE(reply.stalled);
    EXPECT_THAT(reply.data, ElementsAreArray(expected));
  }
  void configure() { ASSERT_FALSE(request(0x00, 9, 1, 0, 0).stalled); }

  W2UsbDevice device_{profiles::load_device_profile("woodenhaptics_v2015").usb};
};

TEST_F(W2UsbDeviceTest, DescriptorsAreThoseOfTheSheet) {
  expect_data(request(0x80, 6, 0x0100, 0, 64), kDevice);
  expect_data(request(0x80, 6, 0x0200, 0, 255), kConfiguration);
  expect_data(request(0x81, 6, 0x2200, 0, 255), kReport);
  expect_data(request(0x81, 6, 0x2100, 0, 9), hex("09 21 11 01 00 01 22 1B 00"));
}

TEST_F(W2UsbDeviceTest, AnswersAreCutToTheLengthAskedFor) {
  expect_data(request(0x80, 6, 0x0100, 0, 8), Bytes(kDevice.begin(), kDevice.begin() + 8));
  expect_data(request(0x80, 6, 0x0200, 0, 9),
              Bytes(kConfiguration.begin(), kConfiguration.begin() + 9));
  expect_data(request(0x80, 6, 0x0100, 0, 0), {});
}

TEST_F(W2UsbDeviceTest, StringsAreThoseOfTheSheet) {
  const auto utf16 = [](const std::string& text) {
    Bytes bytes{static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
    for (const char c : text) {
      bytes.push_back(static_cast<std::uint8_t>(c));
      bytes.push_back(0);
    }
    return bytes;
  };
  expect_data(request(0x80, 6, 0x0300, 0, 255), hex("04 03 09 04"));
  expect_data(request(0x80, 6, 0x0301, 0x0409, 255), utf16("mbed.org"));
  expect_data(request(0x80, 6, 0x0302, 0x0409, 255), utf16("HID DEVICE"));
  expect_data(request(0x80, 6, 0x0303, 0x0409, 255), utf16("0123456789"));
  expect_data(request(0x80, 6, 0x0304, 0x0409, 255), utf16("01"));
  expect_data(request(0x80, 6, 0x0305, 0x0409, 255), utf16("HID"));
  EXPECT_TRUE(request(0x80, 6, 0x0306, 0x0409, 255).stalled);
}

TEST_F(W2UsbDeviceTest, ConfigurationTakesOneOrZeroOnly) {
  expect_data(request(0x80, 8, 0, 0, 1), {0});
  EXPECT_FALSE(device_.configured());
  EXPECT_TRUE(request(0x00, 9, 2, 0, 0).stalled);
  EXPECT_FALSE(device_.configured());
  EXPECT_FALSE(request(0x00, 9, 1, 0, 0).stalled);
  EXPECT_TRUE(device_.configured());
  expect_data(request(0x80, 8, 0, 0, 1), {1});
  EXPECT_FALSE(request(0x00, 9, 0, 0, 0).stalled);
  EXPECT_FALSE(device_.configured());
}

TEST_F(W2UsbDeviceTest, GetInterfaceNeedsAConfigurationAndSetInterfaceStalls) {
  EXPECT_TRUE(request(0x81, 10, 0, 0, 1).stalled);
  configure();
  expect_data(request(0x81, 10, 0, 0, 1), {0});
  EXPECT_TRUE(request(0x01, 11, 0, 0, 0).stalled);
}

TEST_F(W2UsbDeviceTest, StatusTellsSelfPoweredAndHalts) {
  expect_data(request(0x80, 0, 0, 0, 2), {1, 0});
  expect_data(request(0x81, 0, 0, 0, 2), {0, 0});
  expect_data(request(0x82, 0, 0, 0x81, 2), {0, 0});
  configure();
  EXPECT_FALSE(request(0x02, 3, 0, 0x81, 0).stalled);
  expect_data(request(0x82, 0, 0, 0x81, 2), {1, 0});
  expect_data(request(0x82, 0, 0, 0x01, 2), {0, 0});
  EXPECT_TRUE(device_.halted(0x81));
  EXPECT_FALSE(request(0x02, 1, 0, 0x81, 0).stalled);
  expect_data(request(0x82, 0, 0, 0x81, 2), {0, 0});
  EXPECT_FALSE(device_.halted(0x81));
}

TEST_F(W2UsbDeviceTest, OtherFeaturesStall) {
  configure();
  EXPECT_TRUE(request(0x00, 3, 1, 0, 0).stalled);     // remote wake-up
  EXPECT_TRUE(request(0x01, 3, 0, 0, 0).stalled);     // interface
  EXPECT_TRUE(request(0x02, 3, 0, 0x83, 0).stalled);  // no such endpoint
}

TEST_F(W2UsbDeviceTest, SetAddressIsTaken) { EXPECT_FALSE(request(0x00, 5, 7, 0, 0).stalled); }

TEST_F(W2UsbDeviceTest, ClassRequestsStallButForSetReportOf63Bytes) {
  configure();
  EXPECT_TRUE(request(0x21, 0x0A, 0, 0, 0).stalled);        // SET_IDLE
  EXPECT_TRUE(request(0xA1, 0x02, 0, 0, 1).stalled);        // GET_IDLE
  EXPECT_TRUE(request(0xA1, 0x01, 0x0100, 0, 14).stalled);  // GET_REPORT
  EXPECT_TRUE(request(0x21, 0x0B, 0, 0, 0).stalled);        // SET_PROTOCOL
  EXPECT_TRUE(request(0xA1, 0x03, 0, 0, 1).stalled);        // GET_PROTOCOL
  EXPECT_TRUE(request(0x21, 0x09, 0x0200, 0, 14, Bytes(14)).stalled);
  EXPECT_TRUE(request(0x21, 0x09, 0x0200, 0, 64, Bytes(64)).stalled);
  EXPECT_FALSE(request(0x21, 0x09, 0x0200, 0, 63, Bytes(63)).stalled);
}

TEST_F(W2UsbDeviceTest, UnknownRequestsStall) {
  EXPECT_TRUE(request(0xC0, 1, 0, 0, 8).stalled);        // vendor
  EXPECT_TRUE(request(0x80, 6, 0x0600, 0, 10).stalled);  // device qualifier
  EXPECT_TRUE(request(0x80, 6, 0x0400, 0, 9).stalled);   // interface descriptor alone
  EXPECT_TRUE(request(0x80, 12, 0, 0, 2).stalled);       // SYNCH_FRAME
  EXPECT_TRUE(request(0x00, 7, 0x0100, 0, 18).stalled);  // SET_DESCRIPTOR
  EXPECT_TRUE(request(0x80, 0x33, 0, 0, 2).stalled);
}

TEST_F(W2UsbDeviceTest, BusResetUnconfigures) {
  configure();
  (void)request(0x02, 3, 0, 0x01, 0);
  device_.bus_reset();
  EXPECT_FALSE(device_.configured());
  EXPECT_FALSE(device_.halted(0x01));
}

// --- W3: Teensy RawHID, the sheet's section 2.2 ---

const Bytes kTeensyConfiguration =
    hex("09 02 49 00 02 01 00 C0 32 "
        "09 04 00 00 02 03 00 00 00 "
        "09 21 11 01 00 01 22 1C 00 "
        "07 05 83 03 40 00 01 "
        "07 05 04 03 40 00 01 "
        "09 04 01 00 02 03 00 00 00 "
        "09 21 11 01 00 01 22 21 00 "
        "07 05 82 03 40 00 01 "
        "07 05 02 03 20 00 02");
const Bytes kTeensyReport =
    hex("06 AB FF 0A 00 02 A1 01 75 08 15 00 26 FF 00 95 40 09 01 81 02 95 40 09 02 91 02 C0");

class TeensyTest : public W2UsbDeviceTest {
 protected:
  TeensyTest() { device_ = W2UsbDevice(profiles::load_device_profile("woodenhaptics_teensy").usb); }
};

TEST_F(TeensyTest, DescriptorsAreThoseOfTheSheet) {
  expect_data(request(0x80, 6, 0x0100, 0, 18),
              hex("12 01 00 02 00 00 00 40 C0 16 86 04 79 02 01 02 03 01"));
  expect_data(request(0x80, 6, 0x0200, 0, 255), kTeensyConfiguration);
  expect_data(request(0x81, 6, 0x2200, 0, 255), kTeensyReport);
  expect_data(request(0x81, 6, 0x2100, 0, 9), hex("09 21 11 01 00 01 22 1C 00"));
  expect_data(request(0x81, 6, 0x2100, 1, 9), hex("09 21 11 01 00 01 22 21 00"));
  const ControlReply serial_line = request(0x81, 6, 0x2200, 1, 255);
  ASSERT_EQ(serial_line.data.size(), 0x21U);
  EXPECT_THAT(Bytes(serial_line.data.begin(), serial_line.data.begin() + 5),
              ElementsAreArray(hex("06 C9 FF 09 04")));  // usage page FFC9, usage 04
  EXPECT_TRUE(request(0x81, 6, 0x2200, 2, 255).stalled);
  EXPECT_EQ(request(0x80, 6, 0x0303, 0x0409, 255).data.size(), 2 + 2 * 7U);  // 1234560
  EXPECT_TRUE(request(0x80, 6, 0x0304, 0x0409, 255).stalled);
  EXPECT_TRUE(request(0x80, 6, 0x0303, 0x0407, 255).stalled) << "a language that it doesn't have";
}

TEST_F(TeensyTest, AHighSpeedDeviceHasAQualifierAndTheOtherSpeed) {
  expect_data(request(0x80, 6, 0x0600, 0, 10), hex("0A 06 00 02 00 00 00 40 01 00"));
  const ControlReply other = request(0x80, 6, 0x0700, 0, 255);
  ASSERT_EQ(other.data.size(), 73U);
  EXPECT_EQ(other.data[1], 7);
}

TEST_F(TeensyTest, AtFullSpeedTheSerialLineIsATeensy3s) {
  auto usb = profiles::load_device_profile("woodenhaptics_teensy").usb;
  usb.frame_period_us = 1000;
  device_ = W2UsbDevice(usb);
  Bytes expected = kTeensyConfiguration;
  expected[61] = 0x81;
  expect_data(request(0x80, 6, 0x0200, 0, 255), expected);
}

TEST_F(TeensyTest, ReportsGoThroughEndpoints3And4AndInterface1HasItsOwn) {
  EXPECT_EQ(device_.endpoint_in(), 0x83);
  EXPECT_EQ(device_.endpoint_out(), 0x04);
  EXPECT_EQ(device_.interfaces(), 2);
  Bytes addresses;
  for (const UsbEndpoint& endpoint : device_.endpoints()) {
    addresses.push_back(endpoint.address);
    EXPECT_EQ(endpoint.packet_bytes, endpoint.address == 0x02 ? 32U : 64U);
  }
  EXPECT_THAT(addresses, ElementsAreArray({0x83, 0x04, 0x82, 0x02}));
}

TEST_F(TeensyTest, AnswersRequestsAsItsLibraryDoes) {
  configure();
  expect_data(request(0x80, 8, 0, 0, 1), {1});
  expect_data(request(0x80, 0, 0, 0, 2), {0, 0});
  EXPECT_TRUE(request(0x81, 0, 0, 0, 2).stalled);   // status of an interface
  EXPECT_TRUE(request(0x81, 10, 0, 0, 1).stalled);  // GET_INTERFACE
  EXPECT_TRUE(request(0x21, 10, 0, 0, 0).stalled);  // SET_IDLE
  EXPECT_FALSE(request(0x21, 9, 0x0300, 1, 4, Bytes(4)).stalled);
  EXPECT_TRUE(request(0x21, 9, 0x0200, 0, 64, Bytes(64)).stalled);
  EXPECT_FALSE(request(0x02, 3, 0, 0x83, 0).stalled);
  EXPECT_TRUE(device_.halted(0x83));
  EXPECT_FALSE(device_.halted(0x03));
  expect_data(request(0x82, 0, 0, 0x83, 2), {1, 0});
  EXPECT_FALSE(request(0x02, 1, 0, 0x83, 0).stalled);
  EXPECT_FALSE(device_.halted(0x83));
}

TEST(W2UsbDevice, TheProfileGivesNumbersAndStrings) {
  W2UsbDevice device(profiles::load_device_profile("phantom_desktop").usb);
  const auto descriptor = device.device_descriptor();
  EXPECT_EQ(descriptor[8], 0x09);  // 0x1209:0x0001
  EXPECT_EQ(descriptor[9], 0x12);
  EXPECT_EQ(descriptor[10], 0x01);
  EXPECT_EQ(descriptor[11], 0x00);
  const auto product = device.control({0x80, 6, 0x0302, 0x0409, 255}, {});
  EXPECT_EQ(product.data.size(), 2 + 2 * std::string("PHANTOM-class 3DOF (emulated)").size());
}

TEST(W2UsbDevice, RefusesWhatItCannotEmulate) {
  auto usb = profiles::load_device_profile("woodenhaptics_v2015").usb;
  usb.protocol = "w1";
  EXPECT_THROW(W2UsbDevice{usb}, std::invalid_argument);
  usb.protocol = "w2";
  usb.report_bytes = 8;
  EXPECT_THROW(W2UsbDevice{usb}, std::invalid_argument);
  usb.report_bytes = 64;
  EXPECT_THROW(W2UsbDevice{usb}, std::invalid_argument);
  usb.protocol = "w3";
  usb.report_bytes = 14;
  EXPECT_THROW(W2UsbDevice{usb}, std::invalid_argument);
  usb.protocol = "w2";
  usb.serial = std::string(127, 'x');
  EXPECT_THROW(W2UsbDevice{usb}, std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid::emulator
