// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <ostream>
#include <random>
#include <span>
#include <vector>

#include "link/udp_socket.h"

namespace forcegrid {

/// What a network does to datagrams, each way. All of it is drawn from one seed.
struct Impairment {
  const char* name = "none";
  double delay_s = 0.0;
  double jitter_s = 0.0;  ///< up to so much more, each on its own: datagrams overtake one another
  double loss = 0.0;      ///< share
  double duplication = 0.0;
  double rate_bit_per_s = 0.0;       ///< 0: no limit; counted with 28 bytes of UDP and IPv4 heads
  std::size_t queue_bytes = 30'000;  ///< waits for the rate limit; what does not fit is lost
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
inline void PrintTo(const Impairment& impairment, std::ostream* out) { *out << impairment.name; }

/// One way: takes datagrams in and gives them out when they are due, in simulated time.
class ImpairedWay {
 public:
  ImpairedWay(const Impairment& impairment, std::uint32_t seed)
      : impairment_(impairment), random_(seed) {}

  void take(double now_s, std::span<const std::byte> datagram) {
    if (share_(random_) < impairment_.loss) {
      ++lost_;
      return;
    }
    const int copies = share_(random_) < impairment_.duplication ? 2 : 1;
    for (int i = 0; i < copies; ++i) {
      double leaves_s = now_s;
      if (impairment_.rate_bit_per_s > 0.0) {
        const double waits_s = std::max(0.0, free_s_ - now_s);
        if (waits_s * impairment_.rate_bit_per_s >
            8.0 * static_cast<double>(impairment_.queue_bytes)) {
          ++lost_;
          continue;
        }
        leaves_s =
            now_s + waits_s +
            8.0 * static_cast<double>(datagram.size() + kHeadBytes) / impairment_.rate_bit_per_s;
        free_s_ = leaves_s;
      }
      const double due_s = leaves_s + impairment_.delay_s + impairment_.jitter_s * share_(random_);
      under_way_.emplace(due_s, std::vector<std::byte>(datagram.begin(), datagram.end()));
    }
  }

  std::optional<std::vector<std::byte>> next_due(double now_s) {
    if (under_way_.empty() || under_way_.begin()->first > now_s) {
      return std::nullopt;
    }
    auto datagram = std::move(under_way_.begin()->second);
    under_way_.erase(under_way_.begin());
    return datagram;
  }

  [[nodiscard]] std::uint64_t lost() const { return lost_; }

 private:
  static constexpr std::size_t kHeadBytes = 28;

  Impairment impairment_;
  std::mt19937 random_;
  std::uniform_real_distribution<double> share_{0.0, 1.0};
  std::multimap<double, std::vector<std::byte>> under_way_;
  double free_s_ = 0.0;
  std::uint64_t lost_ = 0;
};

/// A relay on loopback between a servo's end and a simulator's, to be moved on by hand in simulated
/// time: no thread, no waiting.
class ImpairedNetwork {
 public:
  ImpairedNetwork(const link::Address& simulator, const Impairment& impairment, std::uint32_t seed)
      : simulator_(simulator), there_(impairment, seed), back_(impairment, seed + 1) {}

  /// What the servo takes for the simulator's address.
  [[nodiscard]] const link::Address& address() const { return servo_side_.local_address(); }
  /// Where the simulator sees the servo.
  [[nodiscard]] const link::Address& servo_seen_at() const {
    return simulator_side_.local_address();
  }

  void move_on_to(double now_s) {
    std::array<std::byte, 2048> buffer;
    for (auto got = servo_side_.receive(buffer); got.kind == kDatagram;
         got = servo_side_.receive(buffer)) {
      servo_ = got.sender;
      heard_.emplace_back(buffer.begin(),
                          buffer.begin() + static_cast<std::ptrdiff_t>(got.size_bytes));
      there_.take(now_s, std::span(buffer).first(got.size_bytes));
    }
    for (auto got = simulator_side_.receive(buffer); got.kind == kDatagram;
         got = simulator_side_.receive(buffer)) {
      heard_.emplace_back(buffer.begin(),
                          buffer.begin() + static_cast<std::ptrdiff_t>(got.size_bytes));
      back_.take(now_s, std::span(buffer).first(got.size_bytes));
    }
    while (const auto datagram = there_.next_due(now_s)) {
      simulator_side_.send_to(simulator_, *datagram);
    }
    while (const auto datagram = back_.next_due(now_s)) {
      if (servo_) {
        servo_side_.send_to(*servo_, *datagram);
      }
    }
  }

  /// As who listens on the wire and sends what he likes, with the addresses of both ends.
  [[nodiscard]] const std::vector<std::vector<std::byte>>& heard() const { return heard_; }
  void inject_to_simulator(std::span<const std::byte> datagram) {
    simulator_side_.send_to(simulator_, datagram);
  }
  void inject_to_servo(std::span<const std::byte> datagram) {
    servo_side_.send_to(servo_.value(), datagram);
  }

  [[nodiscard]] const ImpairedWay& there() const { return there_; }
  [[nodiscard]] const ImpairedWay& back() const { return back_; }

 private:
  static constexpr auto kDatagram = link::UdpSocket::Received::Kind::kDatagram;

  static link::Address any_port() {
    return link::parse_address("127.0.0.1:0", link::PortZero::kAllowed);
  }

  link::Address simulator_;
  link::UdpSocket servo_side_{any_port()};
  link::UdpSocket simulator_side_{any_port()};
  std::optional<link::Address> servo_;
  ImpairedWay there_;
  ImpairedWay back_;
  std::vector<std::vector<std::byte>> heard_;
};

}  // namespace forcegrid
