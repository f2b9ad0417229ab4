// SPDX-License-Identifier: Apache-2.0
#include "driver/falcon_codec.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <vector>

namespace forcegrid::driver::falcon {
namespace {

PacketBytes text(const char* characters) {
  PacketBytes bytes{};
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<std::uint8_t>(characters[i]);
  }
  return bytes;
}

std::vector<InPacket> parsed(PacketParser& parser, const std::vector<std::uint8_t>& bytes) {
  std::vector<InPacket> packets;
  InPacket packet;
  for (const std::uint8_t byte : bytes) {
    if (parser.take(byte, packet)) {
      packets.push_back(packet);
    }
  }
  return packets;
}

// --- the sheet's packets ---

TEST(FalconCodec, WritesTheSheetsPackets) {
  EXPECT_EQ(encode({.homing = false}), text("<AAAAAAAAAAAAAA>"));
  EXPECT_EQ(encode({.command = {661, 731, 766}, .leds = kLedBlue, .homing = false}),
            text("<FJCALNCAOPCAEA>"));
  EXPECT_EQ(encode({.command = {-65, 136, -159}, .leds = kLedGreen}), text("<PLPPIIAABGPPDA>"));
  EXPECT_EQ(encode({.command = {4095, -4095, 1}, .leds = kLedRed}), text("<PPPABAAPBAAAJA>"));
  EXPECT_EQ(encode({.command = {1, -1, 4660}, .leds = kLedRed | kLedGreen | kLedBlue}),
            text("<BAAAPPPPEDCBPA>"));
}

TEST(FalconCodec, ReadsTheSheetsPackets) {
  const struct {
    std::vector<std::uint8_t> bytes;
    std::array<std::int16_t, 3> counts;
    std::uint8_t buttons, homed;
  } examples[] = {
      {{0x3C, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41,
        0x3E},
       {0, 0, 0},
       0,
       0},
      {{0x3C, 0x49, 0x4D, 0x42, 0x41, 0x4B, 0x42, 0x4D, 0x50, 0x44, 0x4F, 0x50, 0x50, 0xB1, 0x41,
        0x3E},
       {456, -998, -29},
       0,
       0b111},
      {{0x3C, 0x4A, 0x46, 0x4B, 0x50, 0x48, 0x4B, 0x46, 0x41, 0x50, 0x50, 0x50, 0x50, 0xB5, 0x41,
        0x3E},
       {-1447, 1447, -1},
       0x4,
       0b111},
      {{0x3C, 0x4A, 0x4E, 0x41, 0x41, 0x4F, 0x42, 0x50, 0x50, 0x44, 0x43, 0x42, 0x41, 0x7A, 0x41,
        0x3E},
       {217, -226, 291},
       0x9,
       0b011},
  };
  for (const auto& example : examples) {
    PacketParser parser;
    const auto packets = parsed(parser, example.bytes);
    ASSERT_EQ(packets.size(), 1U);
    EXPECT_EQ(packets[0].counts, example.counts);
    EXPECT_EQ(packets[0].buttons, example.buttons);
    EXPECT_EQ(packets[0].homed, example.homed);
    EXPECT_EQ(parser.skipped_bytes(), 0U);
  }
}

// --- resynchronisation ---

const std::vector<std::uint8_t> kGood = {0x3C, 0x49, 0x4D, 0x42, 0x41, 0x4B, 0x42, 0x4D,
                                         0x50, 0x44, 0x4F, 0x50, 0x50, 0xB1, 0x41, 0x3E};

std::vector<std::uint8_t> joined(std::initializer_list<std::vector<std::uint8_t>> parts) {
  std::vector<std::uint8_t> all;
  for (const auto& part : parts) {
    all.insert(all.end(), part.begin(), part.end());
  }
  return all;
}

TEST(FalconParser, SkipsGarbageBeforeAPacket) {
  PacketParser parser;
  EXPECT_EQ(parsed(parser, joined({{0x00, 0x41, 0x3E, 0xFF, 0x13}, kGood})).size(), 1U);
  EXPECT_EQ(parser.skipped_bytes(), 5U);
}

TEST(FalconParser, FindsThePacketThatFollowsOneCutShort) {
  for (std::size_t cut = 1; cut < kGood.size(); ++cut) {
    PacketParser parser;
    const std::vector<std::uint8_t> begun(kGood.begin(),
                                          kGood.begin() + static_cast<std::ptrdiff_t>(cut));
    const auto packets = parsed(parser, joined({begun, kGood}));
    ASSERT_EQ(packets.size(), 1U) << "cut after " << cut;
    EXPECT_EQ(packets[0].counts[1], -998);
    EXPECT_EQ(parser.skipped_bytes(), cut);
  }
}

TEST(FalconParser, RefusesAPacketWithAnyByteOutOfRange) {
  for (std::size_t at = 0; at < kGood.size(); ++at) {
    for (const std::uint8_t wrong : {std::uint8_t{0x00}, std::uint8_t{0x40}, std::uint8_t{0xFF}}) {
      if (at == 14 && wrong == 0xFF) {
        continue;  // the unused byte may be anything that is no delimiter
      }
      std::vector<std::uint8_t> bad = kGood;
      bad[at] = wrong;
      PacketParser parser;
      EXPECT_EQ(parsed(parser, joined({bad, kGood})).size(), 1U) << "byte " << at;
      EXPECT_EQ(parser.skipped_bytes(), kGood.size()) << "byte " << at;
    }
  }
}

TEST(FalconParser, SurvivesNoiseAndStillFindsEveryWholePacket) {
  constexpr unsigned kSeed = 4301;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_int_distribution<int> byte(0, 255);
  std::uniform_int_distribution<int> length(0, 40);
  std::vector<std::uint8_t> line;
  constexpr std::size_t kPackets = 500;
  for (std::size_t i = 0; i < kPackets; ++i) {
    for (int n = length(random); n > 0; --n) {
      line.push_back(static_cast<std::uint8_t>(byte(random)));
    }
    line.insert(line.end(), kGood.begin(), kGood.end());
  }
  PacketParser parser;
  std::size_t found = 0;
  for (const InPacket& packet : parsed(parser, line)) {
    found += packet.counts == std::array<std::int16_t, 3>{456, -998, -29} ? 1 : 0;
  }
  EXPECT_EQ(found, kPackets);
}

// --- commands ---

TEST(FalconCommands, AreTheSheetsForItsTorques) {
  const struct {
    std::array<double, 3> torque_Nm;
    std::array<std::int16_t, 3> command;
  } examples[] = {
      {{0.024180165286, 0.024180165286, 0.024180165286}, {-241, -241, -241}},
      {{0.015487698043, -0.052724935123, 0.037237237080}, {-154, 527, -372}},
      {{-0.051939684338, 0.012557102218, 0.039382582121}, {519, -125, -393}},
      {{0.166612722942, -0.068462352799, -0.012788825604}, {-1666, 684, 127}},
      {{-0.125387289504, 0.088718020271, -0.078291221778}, {1253, -887, 782}},
      {{0.067827314461, 0.022747931549, -0.038637771494}, {-678, -227, 386}},
      {{0.012081616571, -0.162085114692, 0.114963619770}, {-120, 1620, -1149}},
  };
  for (const auto& example : examples) {
    const Commands commands = commands_for_torque(example.torque_Nm, 10000.0, 4095);
    EXPECT_EQ(commands.command, example.command);
    EXPECT_TRUE(commands.finite);
    EXPECT_FALSE(commands.scaled);
  }
}

TEST(FalconCommands, AreScaledTogetherSoThatTheForceKeepsItsDirection) {
  const Commands commands = commands_for_torque({0.9, -0.45, 0.225}, 10000.0, 4095);
  EXPECT_TRUE(commands.scaled);
  EXPECT_EQ(commands.command, (std::array<std::int16_t, 3>{-4095, 2047, -1023}));
}

TEST(FalconCommands, OfTheLargestFiniteTorqueAreAtTheLimit) {
  constexpr double kHuge = std::numeric_limits<double>::max() / 20000.0;
  const Commands commands = commands_for_torque({kHuge, -kHuge, 0.0}, 10000.0, 4095);
  EXPECT_TRUE(commands.finite);
  EXPECT_EQ(commands.command, (std::array<std::int16_t, 3>{-4095, 4095, 0}));
}

TEST(FalconCommands, OfWhatIsNoNumberAreZero) {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
        std::numeric_limits<double>::max()}) {
    const Commands commands = commands_for_torque({0.1, bad, 0.1}, 10000.0, 4095);
    EXPECT_FALSE(commands.finite);
    EXPECT_EQ(commands.command, (std::array<std::int16_t, 3>{}));
  }
}

TEST(FalconCommands, StayWithinTheirLimitForAnyTorque) {
  constexpr unsigned kSeed = 4302;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> torque_Nm(-3.0, 3.0);
  for (int i = 0; i < 10000; ++i) {
    const std::array<double, 3> wanted = {torque_Nm(random), torque_Nm(random), torque_Nm(random)};
    const Commands commands = commands_for_torque(wanted, 10000.0, 4095);
    double largest = 0.0;
    for (const double each : wanted) {
      largest = std::max(largest, std::abs(10000.0 * each));
    }
    const double factor = std::min(1.0, 4095.0 / largest);
    for (std::size_t motor = 0; motor < 3; ++motor) {
      ASSERT_LE(std::abs(commands.command[motor]), 4095);
      ASSERT_NEAR(commands.command[motor], -10000.0 * factor * wanted[motor], 1.0);
    }
  }
}

}  // namespace
}  // namespace forcegrid::driver::falcon
