// SPDX-License-Identifier: Apache-2.0
// The Falcon: forward kinematics with the last pose as start, and round trips over USB/IP. The
// driver's whole exchange is compared with a bare client on the same emulated device in the same
// run.

#include <arpa/inet.h>
#include <benchmark/benchmark.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "bench/ratios.h"
#include "device_emulator/emulator_server.h"
#include "driver/mechanism.h"
#include "driver/open_device.h"
#include "profiles/device_profile.h"

namespace forcegrid::bench {
namespace {

void falcon_forward_warm(benchmark::State& state) {
  const auto mechanism = driver::make_mechanism(profiles::load_device_profile("falcon"));
  // A fast hand: 0.3 m/s at 1 kHz, about 8 counts per call.
  std::array<std::array<std::int32_t, 6>, 256> path{};
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double phase = 2.0 * M_PI * static_cast<double>(i) / static_cast<double>(path.size());
    path[i] = {static_cast<std::int32_t>(-300.0 + 300.0 * std::sin(phase)),
               static_cast<std::int32_t>(-250.0 + 300.0 * std::sin(phase + 1.0)),
               static_cast<std::int32_t>(-200.0 + 300.0 * std::sin(phase + 2.0))};
  }
  std::size_t at = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(mechanism->forward(path[at]));
    at = (at + 1) % path.size();
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(falcon_forward_warm);

/// An emulated Falcon in this process, with its firmware running.
class Emulated {
 public:
  Emulated() {
    emulator::DeviceOptions device;
    device.profile = profiles::load_device_profile("falcon");
    device.hand = emulator::HandKind::kNone;
    device.firmware_loaded = true;
    emulator::ServerOptions options;
    options.listen = "127.0.0.1:0";
    options.devices = {device};
    server_ = std::make_unique<emulator::EmulatorServer>(options);
    server_->start();
  }
  std::string address() const { return server_->address(); }

 private:
  std::unique_ptr<emulator::EmulatorServer> server_;
};

/// One device serves both sides and outlives the repetitions.
Emulated& device() {
  static Emulated emulated;
  return emulated;
}

/// A minimal USB/IP client: blocking calls on one socket, no checks, no threads.
class BareClient {
 public:
  explicit BareClient(const std::string& address) {
    const std::size_t colon = address.rfind(':');
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(address.substr(colon + 1))));
    ::inet_pton(AF_INET, address.substr(0, colon).c_str(), &to.sin_addr);
    while (!import(to)) {  // the client before may not have been let go of yet
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    control(0x00, 9, 1);       // configuration
    control(0x40, 9, 1);       // latency timer 1 ms
    control(0x40, 3, 0x0002);  // 1.5 MBaud
    control(0x40, 0, 1);       // purge
    control(0x40, 0, 2);
  }
  ~BareClient() { ::close(socket_); }
  BareClient(const BareClient&) = delete;
  BareClient& operator=(const BareClient&) = delete;

  /// Sends one packet, then does IN transfers until 16 bytes of data have arrived.
  void round_trip() {
    constexpr char kZero[] = "<AAAAAAAAAAAABA>";
    const std::uint32_t out = submit(0, 2, 16, {}, reinterpret_cast<const std::uint8_t*>(kZero));
    std::uint32_t in = submit(1, 1, 64, {}, nullptr);
    bool out_done = false;
    for (std::size_t data = 0; data < 16 || !out_done;) {
      std::array<std::uint8_t, 48> header;
      receive(header.data(), header.size());
      const std::uint32_t sequence = big(&header[4]);
      out_done = out_done || sequence == out;
      if (sequence != in) {
        continue;
      }
      const std::uint32_t length = big(&header[24]);
      std::array<std::uint8_t, 64> packet;
      receive(packet.data(), length);
      data += length - 2;
      if (data < 16) {
        in = submit(1, 1, 64, {}, nullptr);
      }
    }
  }

 private:
  /// @returns false if the server refuses.
  bool import(const sockaddr_in& to) {
    socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
    const int on = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) {
      throw std::runtime_error("bare client: connect");
    }
    std::array<std::uint8_t, 40> request = {0x01, 0x11, 0x80, 0x03};
    std::memcpy(request.data() + 8, "1-1", 3);
    send(request.data(), request.size());
    std::array<std::uint8_t, 8> header;
    receive(header.data(), header.size());
    if (big(&header[4]) != 0) {
      ::close(socket_);
      return false;
    }
    std::array<std::uint8_t, 312> device;
    receive(device.data(), device.size());
    device_id_ = (big(&device[288]) << 16) | big(&device[292]);
    return true;
  }
  static std::uint32_t big(const std::uint8_t* bytes) {
    return (static_cast<std::uint32_t>(bytes[0]) << 24) |
           (static_cast<std::uint32_t>(bytes[1]) << 16) |
           (static_cast<std::uint32_t>(bytes[2]) << 8) | bytes[3];
  }
  static void put_big(std::uint8_t* bytes, std::uint32_t value) {
    for (int i = 3; i >= 0; --i, value >>= 8) {
      bytes[i] = static_cast<std::uint8_t>(value & 0xFF);
    }
  }
  void send(const std::uint8_t* bytes, std::size_t size) {
    if (::send(socket_, bytes, size, MSG_NOSIGNAL) != static_cast<ssize_t>(size)) {
      throw std::runtime_error("bare client: send");
    }
  }
  void receive(std::uint8_t* bytes, std::size_t size) {
    if (::recv(socket_, bytes, size, MSG_WAITALL) != static_cast<ssize_t>(size)) {
      throw std::runtime_error("bare client: receive");
    }
  }
  std::uint32_t submit(std::uint32_t direction, std::uint32_t endpoint, std::uint32_t length,
                       const std::array<std::uint8_t, 8>& setup, const std::uint8_t* payload) {
    std::array<std::uint8_t, 48 + 64> message{};
    put_big(&message[0], 1);
    put_big(&message[4], ++sequence_);
    put_big(&message[8], device_id_);
    put_big(&message[12], direction);
    put_big(&message[16], endpoint);
    put_big(&message[24], length);
    std::copy(setup.begin(), setup.end(), message.begin() + 40);
    std::size_t size = 48;
    if (payload != nullptr) {
      std::memcpy(&message[48], payload, length);
      size += length;
    }
    send(message.data(), size);
    return sequence_;
  }
  void control(std::uint8_t type, std::uint8_t request, std::uint16_t value) {
    submit(0, 0, 0,
           {type, request, static_cast<std::uint8_t>(value & 0xFF),
            static_cast<std::uint8_t>(value >> 8), 0, 0, 0, 0},
           nullptr);
    std::array<std::uint8_t, 48> header;
    receive(header.data(), header.size());
  }

  int socket_ = -1;
  std::uint32_t device_id_ = 0;
  std::uint32_t sequence_ = 0;
};

constexpr int kBatch = 100;  // round trips per iteration

void falcon_round_trip_bare(benchmark::State& state) {
  BareClient client(device().address());
  for (auto _ : state) {
    for (int i = 0; i < kBatch; ++i) {
      client.round_trip();
    }
  }
  state.SetItemsProcessed(kBatch * state.iterations());
}
BENCHMARK(falcon_round_trip_bare)->UseRealTime();

void falcon_round_trip(benchmark::State& state) {
  driver::OpenOptions options;
  options.stale_after = std::chrono::seconds(2);
  const auto profile = profiles::load_device_profile("falcon");
  std::unique_ptr<driver::Device> falcon;
  for (int attempt = 0; !falcon; ++attempt) {
    try {
      falcon = driver::open_device("usbip://" + device().address() + "/1-1", profile, options);
    } catch (const driver::DeviceError&) {
      if (attempt == 100) {
        throw;
      }
      // The client before may not have been let go of yet.
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  std::uint64_t goal = falcon->statistics().reports_received;
  for (auto _ : state) {
    goal += kBatch;
    while (falcon->statistics().reports_received < goal) {
      if (falcon->health() != driver::DeviceHealth::kRunning) {
        state.SkipWithError(falcon->failure().c_str());
        return;
      }
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
  }
  state.SetItemsProcessed(kBatch * state.iterations());
}
BENCHMARK(falcon_round_trip)->UseRealTime();

const bool registered = [] {
  report_time("falcon_forward_warm", "<= 1000 ns");
  report_ratio("falcon_round_trip_bare", "falcon_round_trip", ">= 0.95");
  return true;
}();

}  // namespace
}  // namespace forcegrid::bench
