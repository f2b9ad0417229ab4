// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/falcon_firmware.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "falcon_client.h"

namespace forcegrid::emulator {
namespace {

using std::chrono::milliseconds;
using State = FalconFirmware::State;
using testing::ElementsAreArray;

constexpr double kZero_rad = 0.6108652381980153;
constexpr double kCount_rad = 6.359047629780477e-4;

rt::TimePoint at(int time_ms) { return rt::TimePoint(milliseconds(time_ms)); }

class FalconFirmwareTest : public testing::Test, private FalconFirmware::Board {
 protected:
  FalconFirmware make(bool running, bool homed = false, std::uint64_t seed = 1) {
    return {profiles::load_device_profile("falcon"), *this, seed, running, homed};
  }
  void set_line(FalconFirmware& firmware, double baud_Hz, bool dtr) {
    line_.baud_Hz = baud_Hz;
    line_.dtr = dtr;
    firmware.modem_lines_changed(line_, at(0));
  }
  /// @returns what the firmware sent in answer.
  Bytes feed(FalconFirmware& firmware, const Bytes& bytes, int time_ms = 0) {
    sent_.clear();
    for (const std::uint8_t byte : bytes) {
      firmware.receive(byte, line_, at(time_ms));
    }
    return sent_;
  }
  void set_counts(const std::array<int, 3>& counts) {
    for (std::size_t i = 0; i < 3; ++i) {
      angles_rad_[i] = kZero_rad + kCount_rad * counts[i];
    }
  }
  /// To the loader, ready for an image.
  void boot(FalconFirmware& firmware) {
    set_line(firmware, 9600.0, false);
    set_line(firmware, 9600.0, true);
    EXPECT_EQ(feed(firmware, hex_bytes("0A 43 0D")), hex_bytes("0A 44 2C 0D"));
    set_line(firmware, 142857.0, false);
    EXPECT_EQ(feed(firmware, hex_bytes("41")), hex_bytes("41"));
    EXPECT_EQ(firmware.state(), State::kLoading);
  }

  std::array<double, 3> angles_rad_{kZero_rad, kZero_rad, kZero_rad};
  LineSettings line_;

 private:
  std::array<double, 3> joint_angle_rad(rt::TimePoint /*time*/) noexcept override {
    return angles_rad_;
  }
  void send(std::span<const std::uint8_t> characters, double /*baud_Hz*/,
            rt::TimePoint /*start*/) noexcept override {
    sent_.insert(sent_.end(), characters.begin(), characters.end());
  }
  Bytes sent_;
};

TEST_F(FalconFirmwareTest, ColdAnswersTheGreetingAndNothingElse) {
  auto firmware = make(false);
  set_line(firmware, 9600.0, true);
  EXPECT_TRUE(feed(firmware, hex_bytes("0A 43 0A 0D 41 3C")).empty());
  EXPECT_EQ(feed(firmware, hex_bytes("00 0A 0A 43 0D")), hex_bytes("0A 44 2C 0D"));
  EXPECT_EQ(feed(firmware, hex_bytes("0A 43 0D")), hex_bytes("0A 44 2C 0D")) << "asked again";
  EXPECT_EQ(firmware.statistics().handshakes, 2U);
  auto fast = make(false);
  set_line(fast, 1.5e6, false);
  EXPECT_TRUE(feed(fast, hex_bytes("0A 43 0D")).empty()) << "at another speed it is noise";
  EXPECT_TRUE(feed(fast, FalconClient::packet({0, 0, 0}, 0, false)).empty());
}

TEST_F(FalconFirmwareTest, AutoBaudNeedsTheGreetingTheSpeedAndDtrLow) {
  auto firmware = make(false);
  set_line(firmware, 142857.0, false);
  EXPECT_TRUE(feed(firmware, hex_bytes("41")).empty()) << "no greeting yet";
  set_line(firmware, 9600.0, true);
  feed(firmware, hex_bytes("0A 43 0D"));
  EXPECT_TRUE(feed(firmware, hex_bytes("41")).empty()) << "9600 Bd";
  set_line(firmware, 142857.0, true);
  EXPECT_TRUE(feed(firmware, hex_bytes("41")).empty()) << "DTR is high";
  set_line(firmware, 142857.0, false);
  EXPECT_TRUE(feed(firmware, hex_bytes("42")).empty());
  EXPECT_EQ(feed(firmware, hex_bytes("61")), hex_bytes("61"));
  EXPECT_EQ(firmware.state(), State::kLoading);
}

TEST_F(FalconFirmwareTest, AcceptsTheDivisorsThatOtherClientsCompute) {
  for (const double divisor : {21.0, 21.375, 21.5}) {
    auto firmware = make(false);
    set_line(firmware, 9600.0, true);
    feed(firmware, hex_bytes("0A 43 0D"));
    set_line(firmware, 3e6 / divisor, false);
    EXPECT_EQ(feed(firmware, hex_bytes("41")), hex_bytes("41")) << divisor;
  }
  for (const double divisor : {2.0, 2.125}) {
    auto firmware = make(true);
    set_line(firmware, 3e6 / divisor, false);
    EXPECT_EQ(feed(firmware, FalconClient::packet({0, 0, 0}, 0, false)).size(), 16U) << divisor;
  }
  auto firmware = make(true);
  set_line(firmware, 3e6 / 2.5, false);
  EXPECT_TRUE(feed(firmware, FalconClient::packet({0, 0, 0}, 0, false)).empty());
}

TEST_F(FalconFirmwareTest, EchoesImagesAndRunsThemWithTheirLastByte) {
  for (const Bytes& image :
       {FalconClient::image_without_blocks(), FalconClient::image_with_block()}) {
    auto firmware = make(false);
    boot(firmware);
    const Bytes all_but_last(image.begin(), image.end() - 1);
    EXPECT_THAT(feed(firmware, all_but_last), ElementsAreArray(all_but_last));
    EXPECT_EQ(firmware.state(), State::kLoading);
    EXPECT_EQ(feed(firmware, {image.back()}), Bytes{image.back()});
    EXPECT_EQ(firmware.state(), State::kRunning);
    EXPECT_EQ(firmware.statistics().bytes_loaded, image.size());
    EXPECT_EQ(firmware.statistics().firmware_starts, 1U);
  }
}

TEST_F(FalconFirmwareTest, ImageWithAWrongKeyIsEchoedAndNeverRuns) {
  auto firmware = make(false);
  boot(firmware);
  Bytes image = FalconClient::image_without_blocks();
  image[0] = 0xAB;
  EXPECT_THAT(feed(firmware, image), ElementsAreArray(image));
  EXPECT_EQ(feed(firmware, FalconClient::image_without_blocks()),
            FalconClient::image_without_blocks());
  EXPECT_EQ(firmware.state(), State::kLoading);
  EXPECT_EQ(firmware.statistics().wrong_keys, 1U);
  boot(firmware);
  feed(firmware, FalconClient::image_without_blocks());
  EXPECT_EQ(firmware.state(), State::kRunning) << "the DTR sequence gets it out";
}

TEST_F(FalconFirmwareTest, TruncatedImageLeavesItLoading) {
  auto firmware = make(false);
  boot(firmware);
  const Bytes& image = FalconClient::image_with_block();
  feed(firmware, Bytes(image.begin(), image.end() - 2));
  set_line(firmware, 1.5e6, false);
  EXPECT_TRUE(feed(firmware, FalconClient::packet({0, 0, 0}, 0, false)).empty());
  EXPECT_EQ(firmware.state(), State::kLoading);
}

TEST_F(FalconFirmwareTest, DtrRisingAtBootSpeedStopsTheFirmwareAndItsMotors) {
  auto firmware = make(true, true);
  set_line(firmware, 1.5e6, false);
  feed(firmware, FalconClient::packet({100, 0, 0}, 0, true));
  set_line(firmware, 1.5e6, true);
  EXPECT_EQ(firmware.state(), State::kRunning) << "not at this speed";
  set_line(firmware, 9600.0, true);
  EXPECT_EQ(firmware.state(), State::kRunning) << "the edge counts, not the level";
  set_line(firmware, 9600.0, false);
  set_line(firmware, 9600.0, true);
  EXPECT_EQ(firmware.state(), State::kCold);
  EXPECT_EQ(firmware.commands(), (std::array<std::int32_t, 3>{0, 0, 0}));
  EXPECT_EQ(firmware.statistics().watchdog_trips, 0U);
}

TEST_F(FalconFirmwareTest, TakesTheSheetsPackets) {
  // Section 9.5.
  struct Row {
    std::array<std::int32_t, 3> commands;
    std::uint8_t lights;
    const char* packet;
  };
  for (const Row& row :
       {Row{{0, 0, 0}, 0, "3C 41 41 41 41 41 41 41 41 41 41 41 41 41 41 3E"},
        Row{{661, 731, 766}, 4, "3C 46 4A 43 41 4C 4E 43 41 4F 50 43 41 45 41 3E"},
        Row{{-65, 136, -159}, 2, "3C 50 4C 50 50 49 49 41 41 42 47 50 50 44 41 3E"},
        Row{{4095, -4095, 1}, 8, "3C 50 50 50 41 42 41 41 50 42 41 41 41 4A 41 3E"},
        // 4660 is beyond the limit of 4095.
        Row{{1, -1, 4095}, 14, "3C 42 41 41 41 50 50 50 50 45 44 43 42 50 41 3E"}}) {
    auto firmware = make(true);
    set_line(firmware, 1.5e6, false);
    EXPECT_EQ(feed(firmware, hex_bytes(row.packet)).size(), 16U) << row.packet;
    EXPECT_EQ(firmware.commands(), row.commands) << row.packet;
    EXPECT_EQ(firmware.lights(), row.lights) << row.packet;
  }
}

TEST_F(FalconFirmwareTest, GivesTheSheetsPackets) {
  // Section 9.6, with all axes homed.
  struct Row {
    std::array<int, 3> encoders;
    std::uint8_t buttons;
    bool homing;
    const char* packet;
  };
  for (const Row& row :
       {Row{{0, 0, 0}, 0, false, "3C 41 41 41 41 41 41 41 41 41 41 41 41 41 41 3E"},
        Row{{456, -998, -29}, 0, true, "3C 49 4D 42 41 4B 42 4D 50 44 4F 50 50 B1 41 3E"},
        Row{{-1447, 1447, -1}, 4, true, "3C 4A 46 4B 50 48 4B 46 41 50 50 50 50 B5 41 3E"}}) {
    auto firmware = make(true, true);
    set_line(firmware, 1.5e6, false);
    set_counts(row.encoders);
    firmware.set_buttons(row.buttons);
    EXPECT_THAT(feed(firmware, FalconClient::packet({0, 0, 0}, 0, row.homing)),
                ElementsAreArray(hex_bytes(row.packet)));
  }
}

TEST_F(FalconFirmwareTest, HomedAxesAndAbsoluteCountersComeOneByOne) {
  auto firmware = make(true);
  set_line(firmware, 1.5e6, false);
  set_counts({217, -226, 291});
  FalconState state;
  ASSERT_TRUE(FalconClient::parse(feed(firmware, FalconClient::packet({0, 0, 0}, 8, true)), state));
  EXPECT_EQ(state.homed, 0);
  const auto unknown = state.encoders;
  // The sheet's last packet: axes 1 and 2 homed, buttons 9.
  const double out_rad = 1.06;  // above 60 degrees
  const double in_rad = 0.17;   // below 10 degrees
  firmware.turn({out_rad, out_rad, 1.04});
  firmware.turn({in_rad, in_rad, in_rad});
  EXPECT_EQ(firmware.homed(), (std::array<bool, 3>{true, true, false}));
  firmware.set_buttons(9);
  const Bytes packet = feed(firmware, FalconClient::packet({0, 0, 0}, 8, true));
  ASSERT_TRUE(FalconClient::parse(packet, state));
  EXPECT_EQ(packet[13], 0x7A);
  EXPECT_EQ(state.encoders[0], 217);
  EXPECT_EQ(state.encoders[1], -226);
  EXPECT_EQ(state.encoders[2], unknown[2]) << "still off by its offset";
  firmware.turn({in_rad, in_rad, out_rad});
  firmware.turn({in_rad, in_rad, in_rad});
  EXPECT_TRUE(firmware.all_homed());
  EXPECT_EQ(firmware.statistics().homings, 1U);
}

TEST_F(FalconFirmwareTest, NothingIsHomedWithoutTheHomingBit) {
  auto firmware = make(true);
  set_line(firmware, 1.5e6, false);
  feed(firmware, FalconClient::packet({0, 0, 0}, 0, false));
  firmware.turn({1.1, 1.1, 1.1});
  firmware.turn({0.1, 0.1, 0.1});
  EXPECT_FALSE(firmware.all_homed());
  feed(firmware, FalconClient::packet({0, 0, 0}, 0, true));
  firmware.turn({0.1, 0.1, 0.1});
  EXPECT_FALSE(firmware.all_homed()) << "it has to be pulled out with the bit set";
}

TEST_F(FalconFirmwareTest, OffsetsAreSeededAndDrawnAnewWithEachStart) {
  set_counts({0, 0, 0});
  const auto offsets = [this](std::uint64_t seed) {
    return make(true, false, seed).counters(angles_rad_);
  };
  EXPECT_EQ(offsets(1), offsets(1));
  EXPECT_NE(offsets(1), offsets(2));
  auto firmware = make(false);
  boot(firmware);
  const auto before = firmware.counters(angles_rad_);
  feed(firmware, FalconClient::image_without_blocks());
  EXPECT_NE(firmware.counters(angles_rad_), before);
  for (const std::int32_t offset : before) {
    EXPECT_LE(std::abs(offset), FalconFirmware::kOffsetRange_counts);
  }
}

TEST_F(FalconFirmwareTest, SkipsWhatIsNoPacketAndFindsTheNextOne) {
  auto firmware = make(true);
  set_line(firmware, 1.5e6, false);
  const Bytes good = FalconClient::packet({5, 6, 7}, 0, true);
  Bytes cut(good.begin(), good.begin() + 9);
  cut.insert(cut.end(), good.begin(), good.end());
  EXPECT_EQ(feed(firmware, cut).size(), 16U) << "a packet that begins within another";
  EXPECT_EQ(firmware.statistics().malformed_packets, 1U);
  Bytes noise = hex_bytes("41 3E 00 FF 42");
  noise.insert(noise.end(), good.begin(), good.end());
  EXPECT_EQ(feed(firmware, noise).size(), 16U);
  Bytes wrong_end = FalconClient::packet({900, 900, 900}, 0, true);
  wrong_end[15] = 0x3F;
  EXPECT_TRUE(feed(firmware, wrong_end).empty());
  Bytes wrong_nibble = FalconClient::packet({900, 900, 900}, 0, true);
  wrong_nibble[4] = 0x51;
  EXPECT_TRUE(feed(firmware, wrong_nibble).empty());
  EXPECT_EQ(firmware.commands(), (std::array<std::int32_t, 3>{5, 6, 7})) << "nothing of them acts";
  EXPECT_EQ(firmware.statistics().malformed_packets, 3U);
  EXPECT_EQ(feed(firmware, good).size(), 16U);
}

TEST_F(FalconFirmwareTest, WatchdogCutsTheMotorsAfterATenthOfASecond) {
  auto firmware = make(true);
  set_line(firmware, 1.5e6, false);
  EXPECT_FALSE(firmware.watchdog_deadline().has_value());
  feed(firmware, FalconClient::packet({100, 0, 0}, 0, true), 10);
  EXPECT_EQ(firmware.watchdog_deadline(), at(110));
  firmware.check_watchdog(at(109));
  EXPECT_EQ(firmware.commands()[0], 100);
  firmware.check_watchdog(at(110));
  EXPECT_EQ(firmware.commands()[0], 0);
  EXPECT_EQ(firmware.statistics().watchdog_trips, 1U);
  EXPECT_FALSE(firmware.watchdog_deadline().has_value()) << "once, until it is fed again";
}

}  // namespace
}  // namespace forcegrid::emulator
