// SPDX-License-Identifier: Apache-2.0
#include "falcon_client.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace forcegrid::emulator {

Bytes hex_bytes(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 3) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

void FalconClient::enter_normal_mode() {
  EXPECT_TRUE(vendor(0x00, 0x0001));
  EXPECT_TRUE(vendor(0x00, 0x0002));
  EXPECT_TRUE(vendor(0x09, 0x0001));
  EXPECT_TRUE(vendor(0x03, 0x0002));
  EXPECT_TRUE(vendor(0x00, 0x0001));
  EXPECT_TRUE(vendor(0x00, 0x0002));
}

bool FalconClient::probe(int attempts) {
  FalconState state;
  for (int i = 0; i < attempts; ++i) {
    wire_.write(packet({0, 0, 0}, 0, false));
    const Bytes in = wire_.read(64);
    if (in.size() == 18 && parse(Bytes(in.begin() + 2, in.end()), state)) {
      return true;
    }
  }
  return false;
}

Bytes FalconClient::shake_hands() {
  EXPECT_TRUE(vendor(0x00, 0x0001));
  EXPECT_TRUE(vendor(0x00, 0x0002));
  EXPECT_TRUE(vendor(0x09, 0x0010));
  EXPECT_TRUE(vendor(0x03, 0x4138));
  EXPECT_TRUE(vendor(0x04, 0x0008));
  EXPECT_TRUE(vendor(0x02, 0x0000));
  EXPECT_TRUE(vendor(0x01, 0x0200));
  EXPECT_TRUE(vendor(0x01, 0x0100));
  EXPECT_TRUE(vendor(0x01, 0x0101));
  EXPECT_EQ(wire_.write(hex_bytes("0A 43 0D")), 3U);
  return wire_.read(512);
}

Bytes FalconClient::set_auto_baud() {
  EXPECT_TRUE(vendor(0x01, 0x0100));
  EXPECT_TRUE(vendor(0x03, 0x0015));
  EXPECT_EQ(wire_.write(hex_bytes("41")), 1U);
  return wire_.read(512);
}

bool FalconClient::download(const Bytes& image, std::size_t chunk_bytes) {
  for (std::size_t at = 0; at < image.size(); at += chunk_bytes) {
    const std::size_t size = std::min(chunk_bytes, image.size() - at);
    const auto begin = image.begin() + static_cast<std::ptrdiff_t>(at);
    const Bytes chunk(begin, begin + static_cast<std::ptrdiff_t>(size));
    if (wire_.write(chunk) != size) {
      return false;
    }
    Bytes echo;
    for (int reads = 0; echo.size() < size && reads < 100; ++reads) {
      const Bytes in = wire_.read(std::min<std::size_t>(size + 2, 64));
      if (in.size() > 2) {
        echo.insert(echo.end(), in.begin() + 2, in.end());
      }
    }
    if (echo != chunk) {
      return false;
    }
  }
  EXPECT_TRUE(vendor(0x09, 0x0001));
  EXPECT_TRUE(vendor(0x03, 0x0002));
  EXPECT_TRUE(vendor(0x00, 0x0001));
  EXPECT_TRUE(vendor(0x00, 0x0002));
  return true;
}

bool FalconClient::start_up(const Bytes& image) {
  enter_normal_mode();
  const Bytes greeting = shake_hands();
  EXPECT_EQ(greeting, hex_bytes("01 60 0A 44 2C 0D"));
  const Bytes echo = set_auto_baud();
  EXPECT_EQ(echo, hex_bytes("01 60 41"));
  return download(image) && probe(10);
}

bool FalconClient::exchange(const std::array<int, 3>& commands, std::uint8_t lights, bool homing,
                            FalconState& state) {
  if (wire_.write(packet(commands, lights, homing)) != 16) {
    return false;
  }
  for (int i = 0; i < 10; ++i) {
    const Bytes in = wire_.read(64);
    if (in.size() > 2) {
      return parse(Bytes(in.begin() + 2, in.end()), state);
    }
  }
  return false;
}

Bytes FalconClient::packet(const std::array<int, 3>& commands, std::uint8_t lights, bool homing) {
  Bytes bytes{'<'};
  for (const int command : commands) {
    const auto bits = static_cast<std::uint16_t>(static_cast<std::int16_t>(command));
    for (int shift = 0; shift < 16; shift += 4) {
      bytes.push_back(static_cast<std::uint8_t>('A' + ((bits >> shift) & 0xF)));
    }
  }
  bytes.push_back(static_cast<std::uint8_t>('A' + lights + (homing ? 1 : 0)));
  bytes.push_back('A');
  bytes.push_back('>');
  return bytes;
}

bool FalconClient::parse(const Bytes& packet, FalconState& state) {
  if (packet.size() != 16 || packet.front() != '<' || packet.back() != '>') {
    return false;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    int bits = 0;
    for (std::size_t j = 0; j < 4; ++j) {
      bits |= (packet[1 + 4 * axis + j] - 'A') << (4 * j);
    }
    state.encoders[axis] = static_cast<std::int16_t>(bits);
  }
  const int flags = packet[13] - 'A';
  state.buttons = static_cast<std::uint8_t>(flags & 0xF);
  state.homed = static_cast<std::uint8_t>(flags >> 4);
  return true;
}

const Bytes& FalconClient::image_without_blocks() {
  static const Bytes image =
      hex_bytes("AA 08 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 3F 00 02 80 00 00");
  return image;
}

const Bytes& FalconClient::image_with_block() {
  static const Bytes image = hex_bytes(
      "AA 08 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 3F 00 02 80 "
      "02 00 3F 00 00 80 34 12 78 56 00 00");
  return image;
}

}  // namespace forcegrid::emulator
