// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

namespace forcegrid::link {
#pragma GCC visibility push(default)

/// A link that can't be set up. `what()` names the address, what is wrong and the remedy.
class LinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An IP address and a UDP port.
struct Address {
  bool is_ipv6 = false;
  /// Network order; the first four bytes for IPv4, the others zero then.
  std::array<std::uint8_t, 16> bytes{};
  std::uint16_t port = 0;  ///< host order

  friend bool operator==(const Address&, const Address&) = default;
};

enum class PortZero : std::uint8_t {
  kRefused,  ///< an address to send to
  kAllowed,  ///< an address to listen on: 0 lets the system choose a free port
};

/// How far a link may reach.
enum class Reach : std::uint8_t {
  kLoopback,  ///< this machine only: nobody else can send to the socket
  kNetwork,   ///< other machines, too: only for a link with a key
};

/// Reads "127.0.0.1:24870" (any of 127.0.0.0/8), "[::1]:24870" or "localhost:24870" (which means
/// 127.0.0.1; no name is ever looked up). With kNetwork it also reads any other numeric address of
/// one machine. The port is decimal, 0..65535, without sign or leading zeros. "0.0.0.0" and "[::]",
/// every address of this machine, are only for listening (PortZero::kAllowed).
/// @throws LinkError for anything else. With kLoopback an address beyond it is refused because
///   datagrams are not authenticated: whoever could reach the socket could move the motors.
/// Real-time: no; set-up only. Threads: any.
Address parse_address(std::string_view text, PortZero port_zero, Reach reach = Reach::kLoopback);

/// 127.0.0.0/8 or ::1. Real-time: yes. Threads: any.
bool is_loopback(const Address& address) noexcept;

/// A block of addresses that share their first bits.
class AddressRange {
 public:
  /// Reads "192.168.1.7", "192.168.1.0/24", "fe80::1" or "2001:db8::/32".
  /// @throws LinkError naming the text if it is none of these, or if bits beyond the length are
  ///   set.
  explicit AddressRange(std::string_view text);

  /// Real-time: bounded, no allocation or throw. Threads: any.
  [[nodiscard]] bool contains(const Address& address) const noexcept;

 private:
  bool is_ipv6_ = false;
  std::array<std::uint8_t, 16> bytes_{};
  int bits_ = 0;
};

/// "127.0.0.1:24870" or "[::1]:24870", as parse_address() reads it.
/// Real-time: no (allocates). Threads: any.
std::string to_string(const Address& address);

#pragma GCC visibility pop
}  // namespace forcegrid::link
