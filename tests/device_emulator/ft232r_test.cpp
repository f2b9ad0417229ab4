// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/ft232r.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "device_emulator/ft232r_usb.h"

namespace forcegrid::emulator {
namespace {

using Bytes = std::vector<std::uint8_t>;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::ElementsAreArray;

rt::TimePoint at(rt::Duration time) { return rt::TimePoint(std::chrono::seconds(50) + time); }

/// Keeps what it gets.
class Recorder final : public SerialPeer {
 public:
  void receive(std::uint8_t character, const LineSettings& /*line*/,
               rt::TimePoint time) noexcept override {
    characters.push_back(character);
    last = time;
  }
  void modem_lines_changed(const LineSettings& line, rt::TimePoint /*time*/) noexcept override {
    changes.push_back((line.dtr ? 1 : 0) | (line.rts ? 2 : 0));
  }
  Bytes characters;
  rt::TimePoint last{};
  std::vector<int> changes;
};

Bytes counting(std::size_t size) {
  Bytes bytes(size);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  return bytes;
}

class Ft232rTest : public testing::Test {
 protected:
  void SetUp() override {
    bridge_.set_baud(1.5e6);
    bridge_.set_latency_ms(1);
  }
  /// The IN packet at `time`; empty for NAK.
  Bytes collect(rt::Duration time) {
    bridge_.advance_to(at(time), peer_);
    const auto packet = bridge_.in_packet(at(time));
    if (!packet) {
      return {};
    }
    bridge_.in_taken(at(time));
    bridge_.set_asked(true, at(time));
    return {packet->data().begin(), packet->data().end()};
  }
  Ft232r bridge_;
  Recorder peer_;
};

TEST_F(Ft232rTest, DivisorsAreThoseOfTheSheet) {
  const auto baud = [](std::uint32_t divisor) { return Ft232r::baud_of_divisor(divisor).value(); };
  EXPECT_DOUBLE_EQ(baud(0x4138), 9600.0);
  EXPECT_NEAR(baud(0x0015), 142857.14, 0.01);
  EXPECT_DOUBLE_EQ(baud(0x0002), 1.5e6);
  EXPECT_DOUBLE_EQ(baud(0x0000), 3e6);
  EXPECT_DOUBLE_EQ(baud(0x0001), 2e6);
  // All eighths of 100: the codes 000 to 111 mean 0, 4, 2, 1, 3, 5, 6, 7.
  const std::array<double, 8> eighths = {0, 4, 2, 1, 3, 5, 6, 7};
  for (std::uint32_t code = 0; code < 8; ++code) {
    EXPECT_DOUBLE_EQ(baud(100 | code << 14), 3e6 / (100.0 + eighths[code] / 8.0)) << code;
  }
  EXPECT_FALSE(Ft232r::baud_of_divisor(0x4000).has_value()) << "0.5 is no divisor";
  EXPECT_FALSE(Ft232r::baud_of_divisor(0x4001).has_value()) << "nor is 1.5";
}

TEST_F(Ft232rTest, CharactersTakeTheirTimeOnTheLine) {
  ASSERT_TRUE(bridge_.offer_out(counting(16), at(milliseconds(0))));
  // 16 characters of ten bits at 1.5 MBd: 106.67 us.
  bridge_.advance_to(at(microseconds(100)), peer_);
  EXPECT_EQ(peer_.characters.size(), 15U);
  bridge_.advance_to(at(microseconds(200)), peer_);
  EXPECT_THAT(peer_.characters, ElementsAreArray(counting(16)));
  EXPECT_NEAR(1e6 * rt::seconds(peer_.last - at(microseconds(0))), 106.67, 0.05);
}

TEST_F(Ft232rTest, PacketThatDoesNotFitIsNotTaken) {
  bridge_.set_baud(9600.0);
  EXPECT_TRUE(bridge_.offer_out(counting(64), at(milliseconds(0))));
  EXPECT_TRUE(bridge_.offer_out(counting(64), at(milliseconds(0))));
  EXPECT_FALSE(bridge_.offer_out(counting(1), at(milliseconds(0)))) << "128 bytes";
  // One character takes 1.04 ms.
  bridge_.advance_to(at(milliseconds(2)), peer_);
  EXPECT_TRUE(bridge_.offer_out(counting(1), at(milliseconds(2))));
  EXPECT_FALSE(bridge_.offer_out(counting(1), at(milliseconds(2))));
  bridge_.purge_transmit();
  EXPECT_TRUE(bridge_.offer_out(counting(64), at(milliseconds(2))));
}

TEST_F(Ft232rTest, NothingComesBeforeTheLatencyTimeAndABareStatusAfter) {
  bridge_.set_latency_ms(16);
  bridge_.set_asked(true, at(milliseconds(0)));
  EXPECT_TRUE(collect(microseconds(15900)).empty());
  EXPECT_THAT(collect(milliseconds(16)), ElementsAre(0x01, 0x60));
  EXPECT_TRUE(collect(milliseconds(31)).empty());
  EXPECT_THAT(collect(milliseconds(32)), ElementsAre(0x01, 0x60));
}

TEST_F(Ft232rTest, HostThatBeginsToAskLateStillWaitsTheLatencyTimeForABareStatus) {
  bridge_.set_latency_ms(16);
  bridge_.set_asked(true, at(milliseconds(0)));
  EXPECT_FALSE(collect(milliseconds(16)).empty());
  bridge_.set_asked(false, at(milliseconds(17)));
  bridge_.set_asked(true, at(milliseconds(100)));
  EXPECT_TRUE(collect(milliseconds(115)).empty());
  EXPECT_THAT(collect(milliseconds(116)), ElementsAre(0x01, 0x60));
}

TEST_F(Ft232rTest, DataWaitForTheLatencyTimeSinceTheLastPacket) {
  bridge_.set_asked(true, at(milliseconds(0)));
  EXPECT_THAT(collect(milliseconds(1)), ElementsAre(0x01, 0x60));
  bridge_.send_from_peer(Bytes{7, 8, 9}, 1.5e6, at(microseconds(1200)));
  EXPECT_TRUE(collect(microseconds(1900)).empty());
  EXPECT_THAT(collect(milliseconds(2)), ElementsAre(0x01, 0x60, 7, 8, 9));
}

TEST_F(Ft232rTest, WhatThePeerSendsInOnePieceArrivesInOnePiece) {
  bridge_.set_asked(true, at(milliseconds(0)));
  // 4 characters at 9600 Bd: 4.17 ms; the latency time of 1 ms passes meanwhile.
  bridge_.set_baud(9600.0);
  bridge_.send_from_peer(Bytes{1, 2, 3, 4}, 9600.0, at(milliseconds(0)));
  Bytes data;
  for (int ms = 1; ms < 8; ++ms) {
    const Bytes packet = collect(milliseconds(ms));
    if (packet.size() > 2) {
      EXPECT_EQ(packet.size(), 6U);
      EXPECT_EQ(ms, 5);
    }
  }
}

TEST_F(Ft232rTest, SixtyTwoBytesGoAtOnceWithTwoStatusBytes) {
  bridge_.set_latency_ms(16);
  bridge_.set_asked(true, at(milliseconds(0)));
  EXPECT_FALSE(collect(milliseconds(16)).empty());
  bridge_.send_from_peer(counting(100), 1.5e6, at(milliseconds(17)));
  const Bytes packet = collect(milliseconds(18));
  ASSERT_EQ(packet.size(), 64U);
  EXPECT_EQ(packet[0], 0x01);
  EXPECT_EQ(packet[1], 0x60);
  EXPECT_EQ(packet[2], 0);
  EXPECT_EQ(packet[63], 61);
  EXPECT_TRUE(collect(milliseconds(19)).empty()) << "38 are left: they wait";
  EXPECT_EQ(collect(milliseconds(34)).size(), 40U);
}

TEST_F(Ft232rTest, EventCharacterSendsWhatThereIs) {
  bridge_.set_latency_ms(255);
  bridge_.set_asked(true, at(milliseconds(0)));
  EXPECT_FALSE(collect(milliseconds(255)).empty());
  bridge_.set_event_character('>');
  bridge_.send_from_peer(Bytes{'<', 'A'}, 1.5e6, at(milliseconds(256)));
  EXPECT_TRUE(collect(milliseconds(257)).empty());
  bridge_.send_from_peer(Bytes{'>'}, 1.5e6, at(milliseconds(257)));
  EXPECT_EQ(collect(milliseconds(258)).size(), 5U);
}

TEST_F(Ft232rTest, ReceiveFifoHolds256BytesAndTheRestIsLostCountedAndTold) {
  bridge_.send_from_peer(counting(260), 1.5e6, at(milliseconds(0)));
  bridge_.set_asked(true, at(milliseconds(10)));
  std::size_t got = 0;
  for (int ms = 10; ms < 20; ++ms) {
    const Bytes packet = collect(milliseconds(ms));
    ASSERT_GE(packet.size(), 2U);
    EXPECT_EQ(packet[1] & 0x02, ms == 10 ? 0x02 : 0x00) << "overrun, reported once";
    got += packet.size() - 2;
  }
  EXPECT_EQ(got, 256U);
  EXPECT_EQ(bridge_.statistics().overruns, 4U);
}

TEST_F(Ft232rTest, PurgesEmptyOneDirectionEach) {
  bridge_.set_baud(9600.0);
  ASSERT_TRUE(bridge_.offer_out(counting(10), at(milliseconds(0))));
  bridge_.send_from_peer(Bytes{1, 2, 3}, 9600.0, at(milliseconds(0)));
  bridge_.advance_to(at(milliseconds(5)), peer_);
  EXPECT_EQ(peer_.characters.size(), 4U);
  bridge_.purge_transmit();
  bridge_.advance_to(at(milliseconds(50)), peer_);
  EXPECT_EQ(peer_.characters.size(), 4U);
  bridge_.set_asked(true, at(milliseconds(50)));
  EXPECT_EQ(collect(milliseconds(50)).size(), 5U) << "the other direction is untouched";
  bridge_.send_from_peer(Bytes{1, 2, 3}, 9600.0, at(milliseconds(50)));
  bridge_.advance_to(at(milliseconds(60)), peer_);
  bridge_.purge_receive();
  EXPECT_EQ(collect(milliseconds(60)).size(), 2U);
}

TEST_F(Ft232rTest, WrongSpeedFormatOrBreakCarryNothing) {
  bridge_.set_baud(9600.0);
  bridge_.send_from_peer(Bytes{1, 2}, 142857.0, at(milliseconds(0)));
  bridge_.set_asked(true, at(milliseconds(1)));
  const Bytes packet = collect(milliseconds(2));
  ASSERT_EQ(packet.size(), 2U);
  EXPECT_EQ(packet[1] & 0x08, 0x08) << "framing error";
  EXPECT_EQ(bridge_.statistics().framing_errors, 2U);
  bridge_.set_format(8, 0, 0, true);
  ASSERT_TRUE(bridge_.offer_out(counting(2), at(milliseconds(3))));
  bridge_.advance_to(at(milliseconds(50)), peer_);
  EXPECT_TRUE(peer_.characters.empty()) << "the line is held at break";
  bridge_.set_format(8, 0, 0, false);
  bridge_.advance_to(at(milliseconds(60)), peer_);
  EXPECT_EQ(peer_.characters.size(), 2U);
}

TEST_F(Ft232rTest, HandshakeWithLinesThatNobodyDrivesHoldsTheTransmitter) {
  bridge_.set_flow_control(Ft232r::FlowControl::kRtsCts);
  ASSERT_TRUE(bridge_.offer_out(counting(2), at(milliseconds(0))));
  bridge_.advance_to(at(milliseconds(5)), peer_);
  EXPECT_TRUE(peer_.characters.empty());
  EXPECT_EQ(bridge_.status()[1], 0x00) << "characters wait in FIFO and shift register";
  bridge_.set_flow_control(Ft232r::FlowControl::kNone);
  bridge_.advance_to(at(milliseconds(6)), peer_);
  EXPECT_EQ(peer_.characters.size(), 2U);
}

TEST_F(Ft232rTest, WakeTimeIsWhenTheNextThingHappens) {
  EXPECT_FALSE(bridge_.wake_time().has_value());
  bridge_.set_asked(true, at(milliseconds(0)));
  EXPECT_EQ(bridge_.wake_time(), at(milliseconds(1)));
  ASSERT_TRUE(bridge_.offer_out(counting(16), at(milliseconds(0))));
  const auto sent = bridge_.wake_time();
  ASSERT_TRUE(sent.has_value());
  EXPECT_NEAR(1e6 * rt::seconds(*sent - at(microseconds(0))), 106.67, 0.05);
  bridge_.advance_to(*sent, peer_);
  EXPECT_EQ(peer_.characters.size(), 16U);
}

class Ft232rUsbTest : public testing::Test {
 protected:
  ControlReply request(std::uint8_t type, std::uint8_t request, std::uint16_t value,
                       std::uint16_t index = 0, std::uint16_t length = 0) {
    return usb_.control({type, request, value, index, length}, bridge_, peer_, at(milliseconds(0)));
  }
  bool set(std::uint8_t code, std::uint16_t value, std::uint16_t index = 0) {
    return !request(0x40, code, value, index).stalled;
  }
  Bytes get(std::uint8_t type, std::uint8_t code, std::uint16_t value, std::uint16_t index,
            std::uint16_t length) {
    const auto reply = request(type, code, value, index, length);
    EXPECT_FALSE(reply.stalled);
    return reply.data;
  }
  Ft232r bridge_;
  Recorder peer_;
  Ft232rUsb usb_{profiles::load_device_profile("falcon").usb};
};

TEST_F(Ft232rUsbTest, DescriptorsAreThoseOfTheSheet) {
  EXPECT_THAT(get(0x80, 6, 0x0100, 0, 64),
              ElementsAre(0x12, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x08, 0x03, 0x04, 0x48, 0xCB,
                          0x00, 0x06, 0x01, 0x02, 0x03, 0x01));
  EXPECT_THAT(get(0x80, 6, 0x0200, 0, 255),
              ElementsAre(0x09, 0x02, 0x20, 0x00, 0x01, 0x01, 0x00, 0xA0, 0x2D,  //
                          0x09, 0x04, 0x00, 0x00, 0x02, 0xFF, 0xFF, 0xFF, 0x02,  //
                          0x07, 0x05, 0x81, 0x02, 0x40, 0x00, 0x00,              //
                          0x07, 0x05, 0x02, 0x02, 0x40, 0x00, 0x00));
  EXPECT_EQ(get(0x80, 6, 0x0200, 0, 9).size(), 9U);
  const Bytes product = get(0x80, 6, 0x0302, 0x0409, 255);
  std::string text;
  for (std::size_t i = 2; i < product.size(); i += 2) {
    text.push_back(static_cast<char>(product[i]));
  }
  EXPECT_EQ(text, "FALCON HAPTIC");
  EXPECT_TRUE(request(0x80, 6, 0x0600, 0, 10).stalled) << "no qualifier: full speed only";
}

TEST_F(Ft232rUsbTest, IsConfiguredFromTheStartAndAfterAReset) {
  EXPECT_TRUE(usb_.configured());
  EXPECT_THAT(get(0x80, 8, 0, 0, 1), ElementsAre(1));
  EXPECT_FALSE(request(0x00, 9, 0).stalled);
  EXPECT_FALSE(usb_.configured());
  usb_.bus_reset();
  EXPECT_TRUE(usb_.configured());
  EXPECT_TRUE(request(0x00, 9, 2).stalled);
}

TEST_F(Ft232rUsbTest, EveryRequestOfTheSheetIsTaken) {
  EXPECT_TRUE(set(0x00, 0x0000));
  EXPECT_TRUE(set(0x00, 0x0001));
  EXPECT_TRUE(set(0x00, 0x0002));
  EXPECT_TRUE(set(0x02, 0x0000));
  EXPECT_TRUE(set(0x03, 0x4138));
  EXPECT_DOUBLE_EQ(bridge_.line().baud_Hz, 9600.0);
  EXPECT_TRUE(set(0x03, 0xC002));
  EXPECT_NEAR(bridge_.line().baud_Hz, 3e6 / 2.125, 1e-3);
  EXPECT_TRUE(set(0x03, 0x0015, 0x0001));
  EXPECT_NEAR(bridge_.line().baud_Hz, 3e6 / 21.375, 1e-3) << "bit 16 is in the index";
  EXPECT_TRUE(set(0x04, 0x0008));
  EXPECT_TRUE(bridge_.line().is_8n1());
  EXPECT_TRUE(set(0x04, 0x0108));
  EXPECT_FALSE(bridge_.line().is_8n1());
  EXPECT_TRUE(set(0x09, 0x0001));
  EXPECT_THAT(get(0xC0, 0x0A, 0, 0, 1), ElementsAre(1));
  EXPECT_THAT(get(0xC0, 0x05, 0, 0, 2), ElementsAre(0x01, 0x60));
  EXPECT_THAT(get(0xC0, 0x05, 0, 0, 1), ElementsAre(0x01));
  EXPECT_TRUE(set(0x06, 0x010D));
  EXPECT_TRUE(set(0x07, 0x0000));
  EXPECT_TRUE(set(0x0B, 0x0000));
  EXPECT_EQ(get(0xC0, 0x0C, 0, 0, 1).size(), 1U);
  EXPECT_THAT(get(0xC0, 0x90, 0, 1, 2), ElementsAre(0x03, 0x04)) << "vendor in the EEPROM";
  EXPECT_THAT(get(0xC0, 0x90, 0, 2, 2), ElementsAre(0x48, 0xCB));
}

TEST_F(Ft232rUsbTest, TheEepromIsByteForByteThatOfLibftdisTable) {
  // Laid out by hand from libftdi's doc/EEPROM-structure; the checksum was computed apart.
  const Bytes
      expected =
          {
              0x00, 0x40, 0x03, 0x04, 0x48, 0xCB, 0x00, 0x06, 0xA0, 0x2D, 0x08, 0x00,
              0x00, 0x00,                                                  // numbers
              0x98, 0x0A, 0xA2, 0x1C, 0xBE, 0x12, 0x23, 0x10, 0x05, 0x00,  // strings' places, CBUS
              0x0A, 0x03, 'F',  0,    'T',  0,    'D',  0,    'I',  0,     //
              0x1C, 0x03, 'F',  0,    'A',  0,    'L',  0,    'C',  0,    'O',  0,
              'N',  0,    ' ',  0,    'H',  0,    'A',  0,    'P',  0,    'T',  0,
              'I',  0,    'C',  0,    0x12, 0x03, 'F',  0,    'T',  0,    '0',  0,
              '0',  0,    '0',  0,    '0',  0,    '0',  0,    '1',  0};
  Bytes read;
  for (std::uint16_t address = 0; address < 64; ++address) {
    const Bytes word = get(0xC0, 0x90, 0, address, 2);
    read.insert(read.end(), word.begin(), word.end());
  }
  ASSERT_EQ(read.size(), 128U);
  Bytes padded = expected;
  padded.resize(126, 0);
  padded.insert(padded.end(), {0xC9, 0x05});
  EXPECT_THAT(read, ElementsAreArray(padded));
  EXPECT_THAT(get(0xC0, 0x90, 0, 64 + 1, 2), ElementsAre(0x03, 0x04)) << "addresses repeat";
}

TEST(Ft232rEeprom, StringsThatTheChipHasNoRoomForAreRefusedByName) {
  profiles::DeviceProfile::Usb usb = profiles::load_device_profile("falcon").usb;
  usb.manufacturer = std::string(20, 'M');
  usb.product = std::string(20, 'P');
  usb.serial = std::string(8, 'S');
  EXPECT_NO_THROW(Ft232rUsb{usb});
  usb.serial += 'S';
  try {
    const Ft232rUsb chip{usb};
    ADD_FAILURE() << "49 characters were taken";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(),
                 "usb.manufacturer, usb.product and usb.serial have 49 characters together; an "
                 "FT232R has room for 48");
  }
}

TEST_F(Ft232rUsbTest, ModemControlChangesTheMaskedLinesOnly) {
  EXPECT_TRUE(set(0x01, 0x0101));
  EXPECT_TRUE(set(0x01, 0x0202));
  EXPECT_TRUE(set(0x01, 0x0100));
  EXPECT_TRUE(set(0x01, 0x0100));
  EXPECT_TRUE(set(0x01, 0x0301));
  EXPECT_THAT(peer_.changes, ElementsAre(1, 3, 2, 1)) << "and a level that is there is no change";
  EXPECT_TRUE(set(0x00, 0x0000));
  EXPECT_THAT(peer_.changes, ElementsAre(1, 3, 2, 1, 0)) << "reset lowers both";
}

TEST_F(Ft232rUsbTest, ResetKeepsBaudAndFormatAndClearsTheRest) {
  EXPECT_TRUE(set(0x03, 0x0015));
  EXPECT_TRUE(set(0x04, 0x0108));
  EXPECT_TRUE(set(0x02, 0x0000, 0x0100));
  ASSERT_TRUE(bridge_.offer_out(counting(64), at(milliseconds(0))));
  EXPECT_TRUE(set(0x00, 0x0000));
  EXPECT_NEAR(bridge_.line().baud_Hz, 142857.14, 0.01);
  EXPECT_EQ(bridge_.line().parity, 1);
  EXPECT_EQ(bridge_.status()[1], 0x60) << "nothing waits, nothing holds it";
}

TEST_F(Ft232rUsbTest, WhatTheChipDoesNotKnowIsStalledAndChangesNothing) {
  const double baud_Hz = bridge_.line().baud_Hz;
  EXPECT_FALSE(set(0x03, 0x4001)) << "a divisor of 1.5";
  EXPECT_EQ(bridge_.line().baud_Hz, baud_Hz);
  EXPECT_FALSE(set(0x00, 0x0003));
  EXPECT_FALSE(set(0x02, 0x0000, 0x0300));
  EXPECT_FALSE(set(0x04, 0x0005));
  EXPECT_FALSE(set(0x09, 0x0000));
  EXPECT_FALSE(set(0x09, 0x0100));
  EXPECT_FALSE(set(0x91, 0x1234, 3)) << "EEPROM write";
  EXPECT_FALSE(set(0x42, 0x0000));
  EXPECT_TRUE(request(0xC0, 0x42, 0, 0, 2).stalled);
  EXPECT_TRUE(request(0xC0, 0x03, 0, 0, 2).stalled) << "wrong direction";
  EXPECT_TRUE(request(0x21, 0x09, 0, 0, 0).stalled) << "no class requests";
}

TEST_F(Ft232rUsbTest, EndpointsHaltAndRecover) {
  EXPECT_FALSE(request(0x02, 3, 0, 0x81).stalled);
  EXPECT_TRUE(usb_.halted(0x81));
  EXPECT_FALSE(usb_.halted(0x02));
  EXPECT_THAT(get(0x82, 0, 0, 0x81, 2), ElementsAre(1, 0));
  EXPECT_FALSE(request(0x02, 1, 0, 0x81).stalled);
  EXPECT_FALSE(usb_.halted(0x81));
  EXPECT_FALSE(request(0x02, 3, 0, 0x02).stalled);
  EXPECT_FALSE(request(0x01, 11, 0, 0).stalled) << "SET_INTERFACE clears halts";
  EXPECT_FALSE(usb_.halted(0x02));
  EXPECT_TRUE(request(0x02, 3, 0, 0x83).stalled);
}

}  // namespace
}  // namespace forcegrid::emulator
