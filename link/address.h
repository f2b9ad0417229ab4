#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

namespace forcegrid::link {

/// A link that can't be set up. `what()` names the address, what is wrong and the remedy.
class LinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A loopback address and a UDP port.
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

/// Reads "127.0.0.1:24870" (any of 127.0.0.0/8), "[::1]:24870" or "localhost:24870" (which means
/// 127.0.0.1; no name is ever looked up). The port is decimal, 0..65535, without sign or leading
/// zeros.
/// @throws LinkError for anything else. An address beyond loopback is refused because datagrams
///   are not authenticated: whoever could reach the socket could move the motors.
/// Real-time: no; set-up only. Threads: any.
Address parse_address(std::string_view text, PortZero port_zero);

/// "127.0.0.1:24870" or "[::1]:24870", as parse_address() reads it.
/// Real-time: no (allocates). Threads: any.
std::string to_string(const Address& address);

}  // namespace forcegrid::link
