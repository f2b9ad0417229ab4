// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulator_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

namespace forcegrid::emulator {
namespace {

using Bytes = std::vector<std::uint8_t>;
using testing::ElementsAreArray;
using namespace std::chrono_literals;

Bytes hex(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 3) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

Bytes operator+(Bytes left, const Bytes& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

Bytes word(std::uint32_t value) {
  return {static_cast<std::uint8_t>(value >> 24), static_cast<std::uint8_t>(value >> 16),
          static_cast<std::uint8_t>(value >> 8), static_cast<std::uint8_t>(value)};
}

Bytes text(const std::string& value, std::size_t size) {
  Bytes bytes(value.begin(), value.end());
  bytes.resize(size, 0);
  return bytes;
}

std::uint32_t word_at(const Bytes& bytes, std::size_t offset) {
  return (static_cast<std::uint32_t>(bytes.at(offset)) << 24) |
         (static_cast<std::uint32_t>(bytes.at(offset + 1)) << 16) |
         (static_cast<std::uint32_t>(bytes.at(offset + 2)) << 8) | bytes.at(offset + 3);
}

// Device ids: bus 1, device 2 is 1-1 and device 3 is 1-2.
constexpr std::uint32_t kFirst = 0x00010002;
constexpr std::uint32_t kSecond = 0x00010003;

Bytes submit(std::uint32_t sequence, std::uint32_t devid, std::uint32_t direction,
             std::uint32_t endpoint, std::int32_t length, const Bytes& setup = Bytes(8, 0),
             const Bytes& data = {}) {
  return word(1) + word(sequence) + word(devid) + word(direction) + word(endpoint) + word(0x200) +
         word(static_cast<std::uint32_t>(length)) + word(0) + word(0xFFFFFFFF) + word(1) + setup +
         data;
}

Bytes unlink(std::uint32_t sequence, std::uint32_t devid, std::uint32_t victim) {
  return word(2) + word(sequence) + word(devid) + word(0) + word(0) + word(victim) + Bytes(24, 0);
}

Bytes import_request(const std::string& busid) {
  return hex("01 11 80 03 00 00 00 00") + text(busid, 32);
}

const Bytes kSetConfiguration = hex("00 09 01 00 00 00 00 00");
const Bytes kZeroReport(14, 0);
// 330 mA in motor c.
const Bytes kForceReport = hex("00 00 00 00 4A 01 00 00 00 00 00 00 00 00");

/// A plain TCP client. Every wait is bounded, at a time no healthy machine needs.
class Client {
 public:
  explicit Client(std::uint16_t port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval patience{.tv_sec = 20, .tv_usec = 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~Client() { close(); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void close() {
    if (socket_ >= 0) {
      ::close(socket_);
      socket_ = -1;
    }
  }
  bool connected() const { return connected_; }
  void send(const Bytes& bytes) {
    ASSERT_EQ(::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }
  /// Sends as much as the socket takes within a moment. @returns false once the peer is gone.
  bool push(const Bytes& bytes) {
    return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT) >= 0 ||
           errno == EAGAIN;
  }
  /// Exactly `size` bytes; fewer when the server closes or stays silent.
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
  /// Whether the server has closed: end of stream or reset, not silence.
  bool closed_by_server() {
    std::uint8_t byte = 0;
    const ssize_t got = ::recv(socket_, &byte, 1, 0);
    return got == 0 || (got < 0 && errno == ECONNRESET);
  }

  bool import(const std::string& busid = "1-1") {
    send(import_request(busid));
    return receive(320).size() == 320;
  }
  /// A control transfer on endpoint 0; returns the whole reply.
  Bytes control(std::uint32_t sequence, const Bytes& setup, std::uint32_t devid = kFirst) {
    const bool in = (setup[0] & 0x80) != 0;
    const int length = setup[6] | (setup[7] << 8);
    send(submit(sequence, devid, in ? 1 : 0, 0, length, setup));
    Bytes reply = receive(48);
    if (in && reply.size() == 48) {
      reply = reply + receive(word_at(reply, 24));
    }
    return reply;
  }
  void configure(std::uint32_t devid = kFirst) {
    EXPECT_EQ(word_at(control(1, kSetConfiguration, devid), 20), 0U);
  }
  /// One ping-pong: OUT first, then the IN report that answers it.
  Bytes exchange(std::uint32_t sequence, const Bytes& report, std::uint32_t devid = kFirst) {
    send(submit(sequence, devid, 1, 1, 64) + submit(sequence + 1, devid, 0, 1,
                                                    static_cast<std::int32_t>(report.size()),
                                                    Bytes(8, 0), report));
    Bytes in;
    for (int i = 0; i < 2; ++i) {
      const Bytes header = receive(48);
      if (header.size() < 48) {
        ADD_FAILURE() << "no reply";
        return {};
      }
      EXPECT_EQ(word_at(header, 20), 0U);
      if (word_at(header, 4) == sequence) {
        in = receive(word_at(header, 24));
      }
    }
    return in;
  }
  /// Collects the unsolicited report, a second after configuration.
  Bytes first_report(std::uint32_t sequence, std::uint32_t devid = kFirst) {
    send(submit(sequence, devid, 1, 1, 64));
    const Bytes header = receive(48);
    return header.size() == 48 ? receive(word_at(header, 24)) : Bytes{};
  }

 private:
  int socket_;
  bool connected_ = false;
};

class EmulatorServerTest : public testing::Test {
 protected:
  static DeviceOptions device(const char* profile) {
    DeviceOptions options;
    options.profile = profiles::load_device_profile(profile);
    return options;
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
  bool closes_for(CloseReason reason, std::uint64_t count = 1) {
    return eventually([&] { return server_.statistics().closed_for(reason) == count; });
  }
  void SetUp() override { server_.start(); }

  EmulatorServer server_{
      ServerOptions{"127.0.0.1:0", {device("woodenhaptics_v2015"), device("phantom_desktop")}}};
};

TEST_F(EmulatorServerTest, DeviceListIsThatOfTheProtocolByteForByte) {
  Client client(server_.port());
  client.send(hex("01 11 80 05 00 00 00 00"));
  const Bytes reply = client.receive(12 + 2 * 316);
  ASSERT_EQ(reply.size(), 12U + 2 * 316);
  EXPECT_THAT(Bytes(reply.begin(), reply.begin() + 12),
              ElementsAreArray(hex("01 11 00 05 00 00 00 00 00 00 00 02")));
  const auto expected = [](const std::string& busid, const std::string& numbers) {
    return text("/sys/devices/platform/forcegrid/usb1/" + busid, 256) + text(busid, 32) +
           hex(numbers);
  };
  EXPECT_THAT(Bytes(reply.begin() + 12, reply.begin() + 328),
              ElementsAreArray(expected("1-1",
                                        "00 00 00 01 00 00 00 02 00 00 00 02 "
                                        "12 34 00 06 00 01 00 00 00 00 01 01 03 00 00 00")));
  EXPECT_THAT(Bytes(reply.begin() + 328, reply.end()),
              ElementsAreArray(expected("1-2",
                                        "00 00 00 01 00 00 00 03 00 00 00 02 "
                                        "12 09 00 01 00 01 00 00 00 00 01 01 03 00 00 00")));
  EXPECT_TRUE(client.closed_by_server());
  EXPECT_TRUE(closes_for(CloseReason::kServed));
}

TEST_F(EmulatorServerTest, EnumeratesOverTheWire) {
  Client client(server_.port());
  client.send(import_request("1-1"));
  const Bytes imported = client.receive(320);
  ASSERT_EQ(imported.size(), 320U);
  EXPECT_THAT(Bytes(imported.begin(), imported.begin() + 8),
              ElementsAreArray(hex("01 11 00 03 00 00 00 00")));
  EXPECT_THAT(Bytes(imported.begin() + 264, imported.begin() + 268),
              ElementsAreArray(hex("31 2D 31 00")));

  const Bytes device = client.control(7, hex("80 06 00 01 00 00 40 00"));
  EXPECT_THAT(device,
              ElementsAreArray(hex("00 00 00 03 00 00 00 07 00 00 00 00 00 00 00 00 00 00 00 00 "
                                   "00 00 00 00 00 00 00 12 00 00 00 00 00 00 00 00 00 00 00 00 "
                                   "00 00 00 00 00 00 00 00 "
                                   "12 01 00 02 00 00 00 40 34 12 06 00 01 00 01 02 03 01")));
  const Bytes report = client.control(8, hex("81 06 00 22 00 00 FF 00"));
  EXPECT_THAT(Bytes(report.begin() + 48, report.end()),
              ElementsAreArray(hex("06 AB FF 0A 00 02 A1 01 75 08 15 00 25 FF 95 0E 09 01 81 02 "
                                   "95 0E 09 02 91 02 C0")));
  const Bytes set_idle = client.control(9, hex("21 0A 00 00 00 00 00 00"));
  EXPECT_EQ(static_cast<std::int32_t>(word_at(set_idle, 20)), -32) << "a STALL is -EPIPE";
  const Bytes configured = client.control(10, kSetConfiguration);
  EXPECT_EQ(word_at(configured, 20), 0U);
  EXPECT_TRUE(server_.report().configured);
}

TEST_F(EmulatorServerTest, PingPongCarriesReportsBothWays) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  client.configure();
  EXPECT_THAT(client.first_report(2), ElementsAreArray(kZeroReport));
  // Command 1 with (0, 0, 6000); the next report shows it.
  const Bytes calibrated = client.exchange(10, hex("00 00 00 00 00 00 01 00 00 00 00 00 70 17"));
  EXPECT_THAT(calibrated, ElementsAreArray(hex("00 00 00 00 70 17 00 00 00 00 00 00 00 00")));
  for (std::uint32_t i = 0; i < 50; ++i) {
    ASSERT_EQ(client.exchange(20 + 2 * i, kForceReport).size(), 14U);
  }
  const EmulatorReport report = server_.report();
  EXPECT_EQ(report.reports_sent, 52U);
  EXPECT_EQ(report.reports_received, 51U);
  EXPECT_EQ(report.counters_loaded, 1U);
  EXPECT_NEAR(report.max_abs_current_mA[2], 330.0, 1e-9);
  EXPECT_GE(report.frames, 51U);
  EXPECT_EQ(server_.device().samples().size(), 52U);
}

TEST_F(EmulatorServerTest, CountersAreSampledBetweenTheOutReportAndItsAnswer) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  client.configure();
  ASSERT_EQ(client.first_report(2).size(), 14U);
  for (std::uint32_t i = 0; i < 20; ++i) {
    const auto before = rt::Clock::now();
    ASSERT_EQ(client.exchange(10 + 2 * i, kZeroReport).size(), 14U);
    const auto after = rt::Clock::now();
    const rt::TimePoint sampled{
        std::chrono::nanoseconds(server_.device().samples().back().time_ns)};
    // The frame that serves both began before the bytes were read and may have begun, by the time
    // it takes to run a frame, before they were sent.
    EXPECT_GT(sampled, before - 100ms);
    EXPECT_LT(sampled, after);
  }
}

TEST_F(EmulatorServerTest, PendingTransferCanBeUnlinked) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  client.configure();
  ASSERT_EQ(client.first_report(2).size(), 14U);
  client.send(submit(5, kFirst, 1, 1, 64));  // pends: nothing is armed without an OUT report
  client.send(unlink(6, kFirst, 5));
  const Bytes reply = client.receive(48);
  ASSERT_EQ(reply.size(), 48U);
  EXPECT_EQ(word_at(reply, 0), 4U);
  EXPECT_EQ(word_at(reply, 4), 6U);
  EXPECT_EQ(static_cast<std::int32_t>(word_at(reply, 20)), -104) << "unlinked is -ECONNRESET";
  client.send(unlink(7, kFirst, 5));
  const Bytes late = client.receive(48);
  ASSERT_EQ(late.size(), 48U);
  EXPECT_EQ(word_at(late, 4), 7U);
  EXPECT_EQ(word_at(late, 20), 0U) << "too late: it is not pending";
  // The unlinked transfer takes nothing: the next one gets the report.
  EXPECT_EQ(client.exchange(10, kZeroReport).size(), 14U);
}

TEST_F(EmulatorServerTest, SecondClientOfABusyDeviceIsRefusedAndTheFirstGoesOn) {
  Client first(server_.port());
  ASSERT_TRUE(first.import());
  Client second(server_.port());
  second.send(import_request("1-1"));
  const Bytes refusal = second.receive(8);
  ASSERT_EQ(refusal.size(), 8U);
  EXPECT_THAT(refusal, ElementsAreArray(hex("01 11 00 03 00 00 00 02")));
  EXPECT_TRUE(second.closed_by_server());
  EXPECT_EQ(first.control(3, hex("80 06 00 01 00 00 12 00")).size(), 66U);
  Client other(server_.port());
  EXPECT_TRUE(other.import("1-2"));
}

TEST_F(EmulatorServerTest, UnknownBusIdIsRefused) {
  for (const char* busid : {"1-3", "1-", "", "1-11", "../../etc/passwd"}) {
    Client client(server_.port());
    client.send(import_request(busid));
    const Bytes refusal = client.receive(8);
    ASSERT_EQ(refusal.size(), 8U) << busid;
    EXPECT_NE(word_at(refusal, 4), 0U) << busid;
    EXPECT_TRUE(client.closed_by_server()) << busid;
  }
}

TEST_F(EmulatorServerTest, TwoDevicesServeTwoClientsAtOnce) {
  Client first(server_.port());
  Client second(server_.port());
  ASSERT_TRUE(first.import("1-1"));
  ASSERT_TRUE(second.import("1-2"));
  first.configure(kFirst);
  second.configure(kSecond);
  ASSERT_EQ(first.first_report(2, kFirst).size(), 14U);
  ASSERT_EQ(second.first_report(2, kSecond).size(), 14U);
  for (std::uint32_t i = 0; i < 10; ++i) {
    EXPECT_EQ(first.exchange(10 + 2 * i, kForceReport, kFirst).size(), 14U);
    EXPECT_EQ(second.exchange(10 + 2 * i, kZeroReport, kSecond).size(), 14U);
  }
  EXPECT_NEAR(server_.report(0).max_abs_current_mA[2], 330.0, 1e-9);
  EXPECT_EQ(server_.report(1).max_abs_current_mA[2], 0.0);
}

TEST_F(EmulatorServerTest, EachSpeedHasABusOfItsOwn) {
  // A full-speed arm, a Teensy and a Falcon on one server, as they may stand at one computer.
  EmulatorServer server(ServerOptions{
      "127.0.0.1:0",
      {device("woodenhaptics_v2015"), device("woodenhaptics_teensy"), device("falcon")}});
  server.start();
  EXPECT_EQ(server.device(0).busid(), "1-1");
  EXPECT_EQ(server.device(1).busid(), "2-1");
  EXPECT_EQ(server.device(2).busid(), "1-2");

  Client list(server.port());
  list.send(hex("01 11 80 05 00 00 00 00"));
  const Bytes head = list.receive(12);
  ASSERT_EQ(word_at(head, 8), 3U);
  // Bus, device and speed as the kernel numbers it: 2 full, 3 high.
  for (const char* place :
       {"01 00 00 00 02 00 00 00 02", "02 00 00 00 02 00 00 00 03", "01 00 00 00 03 00 00 00 02"}) {
    const Bytes entry = list.receive(312);
    EXPECT_EQ(Bytes(entry.begin() + 291, entry.begin() + 300), hex(place));
    list.receive(4 * std::size_t{entry.at(311)});  // its interfaces
  }
  EXPECT_TRUE(list.closed_by_server());

  constexpr std::uint32_t kTeensy = 0x00020002;
  Client arm(server.port());
  Client teensy(server.port());
  ASSERT_TRUE(arm.import("1-1"));
  ASSERT_TRUE(teensy.import("2-1"));
  arm.configure(kFirst);
  teensy.configure(kTeensy);
  ASSERT_EQ(arm.first_report(2, kFirst).size(), 14U);
  for (std::uint32_t i = 0; i < 10; ++i) {
    EXPECT_EQ(arm.exchange(10 + 2 * i, kForceReport, kFirst).size(), 14U);
  }
  EXPECT_EQ(word_at(teensy.control(5, hex("80 06 00 01 00 00 12 00"), kTeensy), 24), 18U);
  EXPECT_NEAR(server.report(0).max_abs_current_mA[2], 330.0, 1e-9);
  // Frames are counted by bus: eight times as many on the faster one.
  const EmulatorReport slow = server.report(0);
  const EmulatorReport fast = server.report(1);
  EXPECT_NEAR(static_cast<double>(fast.frames + fast.frames_skipped) /
                  static_cast<double>(slow.frames + slow.frames_skipped),
              8.0, 0.5);
}

TEST_F(EmulatorServerTest, MixedSpeedsKeepTheirOwnTimeAlsoWhenItPassesAsFastAsAsked) {
  ServerOptions options{"127.0.0.1:0",
                        {device("woodenhaptics_teensy"), device("woodenhaptics_v2015")}};
  options.pace = Pace::kAsFastAsAsked;
  EmulatorServer server(options);
  server.start();
  constexpr std::uint32_t kArm = 0x00020002;
  Client arm(server.port());
  ASSERT_TRUE(arm.import("2-1"));
  arm.configure(kArm);
  const std::uint64_t before = server.report(1).frames;
  ASSERT_EQ(arm.first_report(2, kArm).size(), 14U) << "a second of the arm's time later";
  EXPECT_GE(server.report(1).frames, before + 900);
  EXPECT_NEAR(static_cast<double>(server.report(0).frames),
              8.0 * static_cast<double>(server.report(1).frames), 200.0);
}

TEST_F(EmulatorServerTest, EndpointsAnswerErrorsAsABusDoes) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  const auto status_of = [&client](const Bytes& request) {
    client.send(request);
    const Bytes reply = client.receive(48);
    return reply.size() == 48 ? static_cast<std::int32_t>(word_at(reply, 20)) : 1;
  };
  EXPECT_EQ(status_of(submit(2, kFirst, 1, 1, 64)), -71) << "unconfigured: nobody answers";
  client.configure();
  EXPECT_EQ(status_of(submit(3, kFirst, 1, 4, 64)), -32) << "no such endpoint";
  EXPECT_EQ(status_of(submit(4, kFirst, 1, 1, 8)), -75) << "14 bytes into 8: babble";
  EXPECT_EQ(client.first_report(5).size(), 14U) << "the babbled report is still there";
  EXPECT_EQ(word_at(client.control(6, hex("02 03 00 00 81 00 00 00")), 20), 0U);
  EXPECT_EQ(status_of(submit(7, kFirst, 1, 1, 64)), -32) << "halted";
}

TEST_F(EmulatorServerTest, WrongLengthReportsAreTakenAndCounted) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  client.configure();
  ASSERT_EQ(client.first_report(2).size(), 14U);
  EXPECT_EQ(client.exchange(10, Bytes(15, 1)).size(), 14U);
  EXPECT_EQ(client.exchange(20, Bytes(3, 1)).size(), 14U);
  EXPECT_EQ(client.exchange(30, Bytes()).size(), 14U);
  const EmulatorReport report = server_.report();
  EXPECT_EQ(report.long_reports, 1U);
  EXPECT_EQ(report.short_reports, 2U);
  EXPECT_EQ(report.max_abs_current_mA, (std::array<double, 3>{0.0, 0.0, 0.0}));
}

TEST_F(EmulatorServerTest, GarbageClosesOnlyTheConnectionItCameFrom) {
  Client healthy(server_.port());
  ASSERT_TRUE(healthy.import("1-2"));
  struct Case {
    Bytes bytes;
    CloseReason reason;
    bool imported;
  };
  const Bytes wrong_command = word(9) + Bytes(44, 0);
  Bytes isochronous = submit(1, kFirst, 1, 1, 64);
  isochronous[35] = 4;
  isochronous[34] = isochronous[33] = isochronous[32] = 0;
  const Case cases[] = {
      {hex("47 45 54 20 2F 20 48 54"), CloseReason::kBadVersion, false},
      {hex("01 06 80 05 00 00 00 00"), CloseReason::kBadVersion, false},
      {hex("01 11 80 99 00 00 00 00"), CloseReason::kUnknownOperation, false},
      {wrong_command, CloseReason::kUnknownCommand, true},
      {submit(1, kSecond, 1, 1, 64), CloseReason::kWrongDevice, true},
      {submit(1, kFirst, 2, 1, 64), CloseReason::kBadDirection, true},
      {submit(1, kFirst, 1, 1, -1), CloseReason::kBadTransferLength, true},
      {submit(1, kFirst, 0, 1, 0x7FFFFFFF), CloseReason::kBadTransferLength, true},
      {submit(1, kFirst, 0, 1, 65537), CloseReason::kBadTransferLength, true},
      {isochronous, CloseReason::kIsochronous, true},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(to_string(c.reason));
    const std::uint64_t before = server_.statistics().closed_for(c.reason);
    Client client(server_.port());
    if (c.imported) {
      ASSERT_TRUE(eventually([this] { return !server_.report(0).attached; }));
      ASSERT_TRUE(client.import("1-1"));
    }
    client.send(c.bytes);
    EXPECT_TRUE(client.closed_by_server());
    EXPECT_TRUE(closes_for(c.reason, before + 1));
  }
  EXPECT_EQ(healthy.control(3, hex("80 06 00 01 00 00 12 00"), kSecond).size(), 66U);
}

TEST_F(EmulatorServerTest, SurvivesRandomBytesAtEveryStageOfAConnection) {
  constexpr unsigned kSeed = 20240611;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  Client healthy(server_.port());
  ASSERT_TRUE(healthy.import("1-2"));
  for (int i = 0; i < 60; ++i) {
    Bytes noise(1 + random() % 300);
    for (std::uint8_t& byte : noise) {
      byte = static_cast<std::uint8_t>(random());
    }
    Client client(server_.port());
    if (i % 3 == 1) {
      client.push(import_request("1-1") + noise);
    } else if (i % 3 == 2) {
      // A well-formed header whose fields are random below the device id.
      Bytes header =
          word(1 + random() % 2) + word(static_cast<std::uint32_t>(random())) + word(kFirst);
      client.push(import_request("1-1") + header + noise);
    } else {
      client.push(noise);
    }
  }
  EXPECT_TRUE(eventually([this] { return !server_.report(0).attached; }));
  EXPECT_EQ(healthy.control(3, hex("80 06 00 01 00 00 12 00"), kSecond).size(), 66U);
  EXPECT_EQ(server_.report(0).max_abs_current_mA, (std::array<double, 3>{0.0, 0.0, 0.0}));
}

TEST_F(EmulatorServerTest, ConnectionsBeyondTheLimitAreClosedAndCounted) {
  Client healthy(server_.port());
  ASSERT_TRUE(healthy.import("1-2"));
  std::vector<std::unique_ptr<Client>> crowd;
  for (std::size_t i = 0; i < EmulatorServer::kMaxConnections; ++i) {
    crowd.push_back(std::make_unique<Client>(server_.port()));
    ASSERT_TRUE(crowd.back()->connected());
  }
  EXPECT_TRUE(closes_for(CloseReason::kTooManyConnections));
  EXPECT_EQ(healthy.control(3, hex("80 06 00 01 00 00 12 00"), kSecond).size(), 66U);
}

TEST_F(EmulatorServerTest, TruncatedMessagesAreCounted) {
  std::uint64_t expected = 0;
  const Bytes import_bytes = import_request("1-1");
  for (const std::size_t size : {1U, 3U, 8U, 39U}) {
    Client client(server_.port());
    client.send(Bytes(import_bytes.begin(), import_bytes.begin() + static_cast<long>(size)));
    client.close();
    EXPECT_TRUE(closes_for(CloseReason::kTruncated, ++expected)) << size;
  }
  const Bytes message = submit(1, kFirst, 0, 1, 14, Bytes(8, 0), kForceReport);
  for (const std::size_t size : {5U, 47U, 48U, 61U}) {
    Client client(server_.port());
    ASSERT_TRUE(eventually([this] { return !server_.report(0).attached; }));
    ASSERT_TRUE(client.import());
    client.send(Bytes(message.begin(), message.begin() + static_cast<long>(size)));
    client.close();
    EXPECT_TRUE(closes_for(CloseReason::kTruncated, ++expected)) << size;
  }
  EXPECT_EQ(server_.report().max_abs_current_mA[2], 0.0);
}

TEST_F(EmulatorServerTest, MessagesMayArriveInPieces) {
  Client client(server_.port());
  for (const std::uint8_t byte : import_request("1-1")) {
    client.send({byte});
  }
  EXPECT_EQ(client.receive(320).size(), 320U);
  const Bytes request = submit(4, kFirst, 1, 0, 18, hex("80 06 00 01 00 00 12 00"));
  client.send(Bytes(request.begin(), request.begin() + 20));
  std::this_thread::sleep_for(5ms);
  client.send(Bytes(request.begin() + 20, request.end()));
  EXPECT_EQ(client.receive(66).size(), 66U);
}

TEST_F(EmulatorServerTest, TooManyAndRepeatedPendingTransfersCloseTheConnection) {
  {
    Client client(server_.port());
    ASSERT_TRUE(client.import());
    client.configure();
    for (std::uint32_t i = 0; i <= EmulatorServer::kMaxPendingUrbs + 1; ++i) {
      if (!client.push(submit(100 + i, kFirst, 1, 1, 64))) {
        break;
      }
    }
    EXPECT_TRUE(closes_for(CloseReason::kTooManyUrbs));
  }
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  client.configure();
  client.send(submit(3, kFirst, 1, 1, 64) + submit(3, kFirst, 1, 1, 64));
  EXPECT_TRUE(closes_for(CloseReason::kDuplicateSequence));
}

TEST_F(EmulatorServerTest, ClientThatNeverReadsIsDroppedAndFramesGoOn) {
  Client slow(server_.port());
  ASSERT_TRUE(slow.import());
  const Bytes request = submit(4, kFirst, 1, 0, 255, hex("80 06 00 02 00 00 FF 00"));
  Bytes many;
  for (int i = 0; i < 50; ++i) {
    many = many + request;
  }
  const std::uint64_t frames_before = server_.report().frames;
  ASSERT_TRUE(eventually([&] {
    slow.push(many);
    return server_.statistics().closed_for(CloseReason::kSlowClient) == 1;
  }));
  EXPECT_GT(server_.report().frames, frames_before);
  EXPECT_FALSE(server_.report().attached);
}

TEST_F(EmulatorServerTest, CurrentGoesToZeroWhenTheClientVanishesInMidForce) {
  {
    Client client(server_.port());
    ASSERT_TRUE(client.import());
    client.configure();
    ASSERT_EQ(client.first_report(2).size(), 14U);
    (void)client.exchange(5, hex("00 00 00 00 00 00 01 00 00 00 00 00 70 17"));
    for (std::uint32_t i = 0; i < 20; ++i) {
      ASSERT_EQ(client.exchange(10 + 2 * i, kForceReport).size(), 14U);
    }
    ASSERT_NEAR(server_.report().max_abs_current_mA[2], 330.0, 1e-9);
  }
  ASSERT_TRUE(eventually([this] { return server_.report().watchdog_trips >= 1; }));
  const EmulatorReport report = server_.report();
  EXPECT_EQ(report.final_current_mA, (std::array<double, 3>{0.0, 0.0, 0.0}));
  EXPECT_FALSE(report.attached);
  EXPECT_FALSE(report.configured);

  // The firmware has lived on: counters are kept, and there is no second start-up.
  Client next(server_.port());
  ASSERT_TRUE(next.import());
  next.configure();
  const Bytes in = next.first_report(2);
  ASSERT_EQ(in.size(), 14U);
  EXPECT_GT(static_cast<std::int16_t>(in[4] | (in[5] << 8)), 3000);
}

TEST_F(EmulatorServerTest, SilentClientLosesItsCurrentButNotItsDevice) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  client.configure();
  ASSERT_EQ(client.first_report(2).size(), 14U);
  ASSERT_EQ(client.exchange(10, kForceReport).size(), 14U);
  ASSERT_TRUE(eventually([this] { return server_.report().watchdog_trips >= 1; }));
  EXPECT_EQ(server_.report().final_current_mA[2], 0.0);
  EXPECT_TRUE(server_.report().attached);
  // 500 mA: the motors obey again.
  ASSERT_EQ(client.exchange(20, hex("00 00 00 00 F4 01 00 00 00 00 00 00 00 00")).size(), 14U);
  EXPECT_NEAR(server_.report().max_abs_current_mA[2], 500.0, 1e-9);
}

TEST_F(EmulatorServerTest, UnplugClosesTheClientAndHidesTheDeviceUntilReplug) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  server_.device().unplug();
  EXPECT_TRUE(client.closed_by_server());
  EXPECT_TRUE(server_.report().unplugged);
  EXPECT_EQ(server_.statistics().closed_for(CloseReason::kUnplugged), 1U);
  Client refused(server_.port());
  refused.send(import_request("1-1"));
  const Bytes reply = refused.receive(8);
  ASSERT_EQ(reply.size(), 8U);
  EXPECT_EQ(word_at(reply, 4), 4U) << "no device";
  Client lister(server_.port());
  lister.send(hex("01 11 80 05 00 00 00 00"));
  EXPECT_EQ(word_at(lister.receive(12), 8), 1U) << "only the other one is listed";
  server_.device().replug();
  Client again(server_.port());
  EXPECT_TRUE(again.import());
}

TEST_F(EmulatorServerTest, CalibrationButtonShowsInTheReport) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  client.configure();
  ASSERT_EQ(client.first_report(2).size(), 14U);
  server_.device().press_calibration_button();
  EXPECT_EQ(client.exchange(10, kZeroReport).at(12), 1);
}

TEST_F(EmulatorServerTest, StopClosesClientsAndFreesThePort) {
  Client client(server_.port());
  ASSERT_TRUE(client.import());
  const std::string address = server_.address();
  server_.stop();
  EXPECT_TRUE(client.closed_by_server());
  EmulatorServer next(ServerOptions{address, {device("woodenhaptics_v2015")}});
  EXPECT_EQ(next.address(), address);
  EXPECT_FALSE(server_.report().attached) << "reports stay readable";
  server_.stop();
}

TEST_F(EmulatorServerTest, StartingTwiceIsAnError) { EXPECT_THROW(server_.start(), EmulatorError); }

TEST_F(EmulatorServerTest, DeviceBeyondTheLastIsAnError) {
  EXPECT_EQ(server_.device_count(), 2U);
  EXPECT_THROW((void)server_.device(2), std::out_of_range);
}

TEST_F(EmulatorServerTest, SchedulingIsSettledOneWayOrTheOther) {
  const auto scheduling = server_.statistics().scheduling;
  EXPECT_NE(scheduling.realtime, !scheduling.reason.empty());
  if (scheduling.realtime) {
    EXPECT_EQ(scheduling.priority, rt::kEmulatorFramePriority);
  }
}

}  // namespace
}  // namespace forcegrid::emulator
