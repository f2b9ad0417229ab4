// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "device_emulator/emulator_server.h"
#include "falcon_client.h"

namespace forcegrid::emulator {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAreArray;

constexpr std::uint32_t kDevice = 0x00010002;  // bus 1, device 2

void append_word(Bytes& bytes, std::uint32_t value) {
  for (const int shift : {24, 16, 8, 0}) {
    bytes.push_back(static_cast<std::uint8_t>(value >> shift));
  }
}

std::uint32_t word_at(const Bytes& bytes, std::size_t at) {
  return (static_cast<std::uint32_t>(bytes.at(at)) << 24) |
         (static_cast<std::uint32_t>(bytes.at(at + 1)) << 16) |
         (static_cast<std::uint32_t>(bytes.at(at + 2)) << 8) | bytes.at(at + 3);
}

struct Reply {
  bool complete = false;
  std::uint32_t sequence = 0;
  std::int32_t status = 0;
  std::uint32_t actual_bytes = 0;
  Bytes data;
};

/// The Falcon over a plain USB/IP socket, in real time.
class UsbipFalconWire final : public FalconWire {
 public:
  explicit UsbipFalconWire(std::uint16_t port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const int on = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    // No healthy machine needs as long.
    const timeval patience{.tv_sec = 20, .tv_usec = 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  }
  ~UsbipFalconWire() override { ::close(socket_); }
  UsbipFalconWire(const UsbipFalconWire&) = delete;
  UsbipFalconWire& operator=(const UsbipFalconWire&) = delete;

  /// @returns the whole import reply.
  Bytes import() {
    Bytes request = hex_bytes("01 11 80 03 00 00 00 00 31 2D 31");  // "1-1"
    request.resize(40);
    send(request);
    return receive(320);
  }
  Bytes list_devices() {
    send(hex_bytes("01 11 80 05 00 00 00 00"));
    return receive(12 + 316);
  }

  bool control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
               std::uint16_t index, std::uint16_t length, Bytes* reply) override {
    const bool in = (request_type & 0x80) != 0;
    submit(in, 0, length,
           {request_type, request, static_cast<std::uint8_t>(value),
            static_cast<std::uint8_t>(value >> 8), static_cast<std::uint8_t>(index),
            static_cast<std::uint8_t>(index >> 8), static_cast<std::uint8_t>(length),
            static_cast<std::uint8_t>(length >> 8)});
    const Reply done = next_reply(in);
    if (reply != nullptr) {
      *reply = done.data;
    }
    return done.complete && done.status == 0;
  }
  std::size_t write(const Bytes& data) override {
    submit(false, 2, data.size(), {}, data);
    const Reply done = next_reply(false);
    return done.complete && done.status == 0 ? done.actual_bytes : 0;
  }
  Bytes read(std::size_t size) override {
    submit(true, 1, size, {});
    const Reply done = next_reply(true);
    EXPECT_TRUE(done.complete && done.status == 0) << done.status;
    return done.data;
  }

  /// @param setup eight bytes, or none.
  std::uint32_t submit(bool in, std::uint32_t endpoint, std::size_t size, Bytes setup,
                       const Bytes& data = {}) {
    setup.resize(8);
    Bytes message;
    for (const std::uint32_t word : {1U, ++sequence_, kDevice, in ? 1U : 0U, endpoint, 0U,
                                     static_cast<std::uint32_t>(size), 0U, 0xFFFFFFFFU, 0U}) {
      append_word(message, word);
    }
    message.insert(message.end(), setup.begin(), setup.end());
    message.insert(message.end(), data.begin(), data.end());
    send(message);
    return sequence_;
  }
  void unlink(std::uint32_t victim) {
    Bytes message;
    for (const std::uint32_t word : {2U, ++sequence_, kDevice, 0U, 0U, victim}) {
      append_word(message, word);
    }
    message.resize(48);
    send(message);
  }
  /// @param in whether data follow it.
  Reply next_reply(bool in) {
    const Bytes header = receive(48);
    Reply reply;
    if (header.size() < 48) {
      return reply;
    }
    reply.complete = true;
    reply.sequence = word_at(header, 4);
    reply.status = static_cast<std::int32_t>(word_at(header, 20));
    reply.actual_bytes = word_at(header, 24);
    if (in && word_at(header, 0) == 3) {
      reply.data = receive(reply.actual_bytes);
    }
    return reply;
  }
  Bytes receive(std::size_t size) {
    Bytes bytes(size);
    std::size_t got = 0;
    while (got < size) {
      const ssize_t more = ::recv(socket_, bytes.data() + got, size - got, 0);
      if (more <= 0) {
        break;
      }
      got += static_cast<std::size_t>(more);
    }
    bytes.resize(got);
    return bytes;
  }

 private:
  void send(const Bytes& bytes) {
    ASSERT_EQ(::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }
  int socket_;
  std::uint32_t sequence_ = 0;
};

class FalconServerTest : public testing::Test {
 protected:
  static ServerOptions options(bool firmware_loaded) {
    DeviceOptions device;
    device.profile = profiles::load_device_profile("falcon");
    device.firmware_loaded = firmware_loaded;
    device.operator_script.calibrated = firmware_loaded;
    return {.listen = "127.0.0.1:0", .devices = {device}};
  }
  template <typename Condition>
  static bool eventually(Condition&& condition) {
    for (int i = 0; i < 2000; ++i) {
      if (condition()) {
        return true;
      }
      std::this_thread::sleep_for(5ms);
    }
    return false;
  }
};

TEST_F(FalconServerTest, IsListedAndImportedAsAConfiguredVendorDevice) {
  EmulatorServer server(options(false));
  server.start();
  const Bytes list = UsbipFalconWire(server.port()).list_devices();
  ASSERT_EQ(list.size(), 328U);
  // Bus, device, speed; vendor, product, release; class; configuration 1 of 1; one interface FF.
  EXPECT_THAT(Bytes(list.begin() + 300, list.end()),
              ElementsAreArray(hex_bytes("00 00 00 01 00 00 00 02 00 00 00 02 04 03 CB 48 06 00 "
                                         "00 00 00 01 01 01 FF FF FF 00")));
  UsbipFalconWire wire(server.port());
  const Bytes imported = wire.import();
  ASSERT_EQ(imported.size(), 320U);
  EXPECT_THAT(Bytes(imported.begin(), imported.begin() + 8),
              ElementsAreArray(hex_bytes("01 11 00 03 00 00 00 00")));
  Bytes descriptor;
  EXPECT_TRUE(wire.control(0x80, 6, 0x0100, 0, 18, &descriptor));
  EXPECT_THAT(descriptor,
              ElementsAreArray(hex_bytes("12 01 00 02 00 00 00 08 03 04 48 CB 00 06 01 02 03 01")));
}

TEST_F(FalconServerTest, StartsUpHomesAndIsFoundRunningByTheNextClient) {
  EmulatorServer server(options(false));
  server.start();
  FalconState state;
  {
    UsbipFalconWire wire(server.port());
    ASSERT_EQ(wire.import().size(), 320U);
    FalconClient client(wire);
    client.enter_normal_mode();
    EXPECT_FALSE(client.probe(20));
    EXPECT_EQ(client.shake_hands(), hex_bytes("01 60 0A 44 2C 0D"));
    EXPECT_EQ(client.set_auto_baud(), hex_bytes("01 60 41"));
    ASSERT_TRUE(client.download(FalconClient::image_with_block()));
    ASSERT_TRUE(client.probe(10));
    EXPECT_EQ(server.report().falcon->firmware_state, "running");
    const auto begin = std::chrono::steady_clock::now();
    while (state.homed != 7 && std::chrono::steady_clock::now() - begin < 20s) {
      ASSERT_TRUE(client.exchange({0, 0, 0}, 0x08, true, state));
    }
    EXPECT_EQ(state.homed, 7);
    ASSERT_TRUE(client.exchange({300, 300, 300}, 0x02, true, state));
  }
  ASSERT_TRUE(eventually([&server] { return !server.report().attached; }));
  ASSERT_TRUE(eventually([&server] { return server.report().watchdog_trips >= 1; }));
  EXPECT_EQ(server.report().falcon->final_command, (std::array<std::int32_t, 3>{0, 0, 0}));
  UsbipFalconWire wire(server.port());
  ASSERT_EQ(wire.import().size(), 320U);
  FalconClient client(wire);
  client.enter_normal_mode();
  EXPECT_TRUE(client.probe(10)) << "the firmware has stayed";
  ASSERT_TRUE(client.exchange({0, 0, 0}, 0x02, true, state));
  EXPECT_EQ(state.homed, 7);
}

TEST_F(FalconServerTest, AnswersBetweenBusFrames) {
  EmulatorServer server(options(true));
  server.start();
  UsbipFalconWire wire(server.port());
  ASSERT_EQ(wire.import().size(), 320U);
  FalconClient client(wire);
  client.enter_normal_mode();
  ASSERT_TRUE(client.probe(10));
  FalconState state;
  // Write and read of one exchange take two frames if they wait for them. Frames are counted, not
  // time, and on a busy machine this client often misses a frame of its own accord.
  constexpr int kExchanges = 1000;
  int within_a_frame = 0;
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < kExchanges; ++i) {
    const std::uint64_t frames = server.report().frames;
    ASSERT_TRUE(client.exchange({0, 0, 0}, 0x02, true, state));
    within_a_frame += server.report().frames - frames <= 1 ? 1 : 0;
  }
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  RecordProperty("exchanges_per_s", std::to_string(kExchanges / seconds));
  EXPECT_GT(within_a_frame, kExchanges / 20);
}

TEST_F(FalconServerTest, SeveralReadsMayBeQueuedAndOneTakenBack) {
  EmulatorServer server(options(true));
  server.start();
  UsbipFalconWire wire(server.port());
  ASSERT_EQ(wire.import().size(), 320U);
  FalconClient(wire).enter_normal_mode();
  const std::uint32_t first = wire.submit(true, 1, 64, {});
  const std::uint32_t second = wire.submit(true, 1, 512, {});
  EXPECT_EQ(wire.next_reply(true).sequence, first);
  EXPECT_EQ(wire.next_reply(true).sequence, second);
  // 255 ms, so that the unlink comes first.
  ASSERT_TRUE(FalconClient(wire).vendor(0x09, 255));
  const std::uint32_t third = wire.submit(true, 1, 64, {});
  wire.unlink(third);
  EXPECT_EQ(wire.next_reply(true).status, -104) << "-ECONNRESET: unlinked";
}

TEST_F(FalconServerTest, LongTransfersAreMadeOfPackets) {
  // 200 packets in one transfer of 3200 bytes: each is answered, and the answers are read as one
  // transfer, full packets of which carry status bytes every 64.
  EmulatorServer server(options(true));
  server.start();
  UsbipFalconWire wire(server.port());
  ASSERT_EQ(wire.import().size(), 320U);
  FalconClient(wire).enter_normal_mode();
  Bytes packets;
  for (int i = 0; i < 200; ++i) {
    const Bytes packet = FalconClient::packet({i, 0, 0}, 0, true);
    packets.insert(packets.end(), packet.begin(), packet.end());
  }
  // 200 reads wait at any time: the bridge keeps 256 bytes, so that a client which asks for the
  // next only when one has come loses some on a busy machine.
  std::uint32_t awaited = 0;
  for (int i = 0; i < 200; ++i) {
    const std::uint32_t sequence = wire.submit(true, 1, 512, {});
    awaited = awaited == 0 ? sequence : awaited;
  }
  const std::uint32_t out = wire.submit(false, 2, packets.size(), {}, packets);
  Bytes in;
  bool written = false;
  while (in.size() < packets.size() || !written) {
    // The OUT transfer carries no data back.
    const Reply header = wire.next_reply(false);
    ASSERT_TRUE(header.complete) << in.size() << " bytes came";
    ASSERT_EQ(header.status, 0);
    if (header.sequence == out) {
      EXPECT_EQ(header.actual_bytes, packets.size());
      written = true;
      continue;
    }
    ASSERT_EQ(header.sequence, awaited);
    wire.submit(true, 1, 512, {});
    ++awaited;
    awaited += awaited == out ? 1 : 0;
    const Bytes data = wire.receive(header.actual_bytes);
    ASSERT_EQ(data.size(), header.actual_bytes);
    for (std::size_t i = 0; i < data.size(); ++i) {
      if (i % 64 >= 2) {
        in.push_back(data[i]);
      } else if (i % 64 == 0) {
        EXPECT_EQ(data[i], 0x01);
      }
    }
  }
  EXPECT_TRUE(written);
  ASSERT_EQ(in.size(), packets.size());
  FalconState state;
  for (std::size_t i = 0; i < 200; ++i) {
    const auto begin = in.begin() + static_cast<std::ptrdiff_t>(16 * i);
    ASSERT_TRUE(FalconClient::parse(Bytes(begin, begin + 16), state)) << i;
  }
  EXPECT_EQ(server.report().reports_sent, 200U);
  EXPECT_EQ(server.report().falcon->serial_overruns, 0U);
}

TEST_F(FalconServerTest, StandsBesideAnArmOnTheSameBus) {
  auto both = options(true);
  DeviceOptions arm;
  arm.profile = profiles::load_device_profile("woodenhaptics_v2015");
  both.devices.push_back(arm);
  EmulatorServer server(both);
  server.start();
  UsbipFalconWire wire(server.port());
  ASSERT_EQ(wire.import().size(), 320U);
  FalconClient client(wire);
  client.enter_normal_mode();
  EXPECT_TRUE(client.probe(10));
  EXPECT_EQ(server.report(1).device, "woodenhaptics_v2015");
  EXPECT_FALSE(server.report(1).falcon.has_value());
}

}  // namespace
}  // namespace forcegrid::emulator
