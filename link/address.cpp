// SPDX-License-Identifier: Apache-2.0
#include "link/address.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <charconv>
#include <system_error>

namespace forcegrid::link {
namespace {

constexpr std::uint8_t kIpv4LoopbackNet = 127;

[[noreturn]] void fail(std::string_view text, std::string_view reason) {
  std::string shown(text);
  // what() is a C string: a byte 0 in the input would hide the reason.
  std::ranges::replace_if(
      shown, [](char letter) { return letter < ' ' || letter > '~'; }, '?');
  throw LinkError("link address '" + shown + "': " + std::string(reason));
}

std::uint16_t parse_port(std::string_view text, std::string_view digits, PortZero port_zero) {
  unsigned int port = 0;
  const char* end = digits.data() + digits.size();
  const auto [stop, error] = std::from_chars(digits.data(), end, port);
  const bool leading_zero = digits.size() > 1 && digits.front() == '0';
  if (digits.empty() || error != std::errc{} || stop != end || leading_zero || port > 65535) {
    fail(text, "the port must be a decimal number from 0 to 65535, as in 127.0.0.1:24870");
  }
  if (port == 0 && port_zero == PortZero::kRefused) {
    fail(text, "port 0 is only for listening; give the port at which the simulator listens");
  }
  return static_cast<std::uint16_t>(port);
}

/// Text of an IP address without brackets, in network order. inet_pton reads a C string: a byte 0
/// inside would hide what follows it.
bool read_numeric(const std::string& host, bool is_ipv6, std::array<std::uint8_t, 16>& bytes) {
  return host.find('\0') == std::string::npos &&
         ::inet_pton(is_ipv6 ? AF_INET6 : AF_INET, host.c_str(), bytes.data()) == 1;
}

bool bit_of(const std::array<std::uint8_t, 16>& bytes, int bit) noexcept {
  return ((bytes[static_cast<std::size_t>(bit / 8)] >> (7 - bit % 8)) & 1) != 0;
}

bool is_unspecified(const Address& address) {
  return std::ranges::all_of(address.bytes, [](std::uint8_t byte) { return byte == 0; });
}

/// Why a network address does not name one machine; null if it does.
const char* why_no_machine(const Address& address, PortZero port_zero) {
  const auto& bytes = address.bytes;
  if (is_unspecified(address)) {
    return port_zero == PortZero::kAllowed
               ? nullptr
               : "means every address of this machine, which is only for listening; give the "
                 "simulator's own";
  }
  const bool to_many = address.is_ipv6 ? bytes[0] == 0xff : bytes[0] >= 224;
  if (to_many) {
    return "a multicast, broadcast or reserved address; give that of one machine";
  }
  constexpr std::array<std::uint8_t, 12> kMapped = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
  if (address.is_ipv6 && std::equal(kMapped.begin(), kMapped.end(), bytes.begin())) {
    return "an IPv4 address in IPv6 form; write it as A.B.C.D:PORT";
  }
  if (address.is_ipv6 && bytes[0] == 0xfe && (bytes[1] & 0xc0) == 0x80) {
    return "a link-local address, which needs an interface that can't be given here; use a global "
           "or unique local one";
  }
  return nullptr;
}

}  // namespace

bool is_loopback(const Address& address) noexcept {
  if (!address.is_ipv6) {
    return address.bytes[0] == kIpv4LoopbackNet;
  }
  return std::all_of(address.bytes.begin(), address.bytes.end() - 1,
                     [](std::uint8_t byte) { return byte == 0; }) &&
         address.bytes.back() == 1;
}

Address parse_address(std::string_view text, PortZero port_zero, Reach reach) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) {
    fail(text, "no port; write ADDR:PORT, as in 127.0.0.1:24870");
  }
  std::string host(text.substr(0, colon));
  if (host == "localhost") {
    host = "127.0.0.1";
  }
  Address address;
  if (host.size() >= 2 && host.front() == '[' && host.back() == ']') {
    address.is_ipv6 = true;
    host = host.substr(1, host.size() - 2);
  } else if (host.find(':') != std::string::npos) {
    fail(text, "an IPv6 address needs brackets, as in [::1]:24870");
  }
  if (!read_numeric(host, address.is_ipv6, address.bytes)) {
    fail(
        text,
        "not a numeric IP address; write 127.0.0.1:PORT, [::1]:PORT or localhost:PORT (other names "
        "are not looked up)");
  }
  if (reach == Reach::kLoopback && !is_loopback(address)) {
    fail(text,
         "not a loopback address; without a key the link's datagrams are not authenticated, so "
         "anyone who could reach the socket could move the motors, and a link to another machine "
         "needs a key: make one with 'forcegrid keygen FILE', copy the file to both machines and "
         "give --key FILE on both. Or run the simulator on the servo's machine and use "
         "127.0.0.1:PORT");
  }
  if (const char* why = why_no_machine(address, port_zero); why != nullptr) {
    fail(text, why);
  }
  address.port = parse_port(text, text.substr(colon + 1), port_zero);
  return address;
}

AddressRange::AddressRange(std::string_view text) {
  const std::size_t slash = text.find('/');
  const std::string host(text.substr(0, slash));
  is_ipv6_ = host.find(':') != std::string::npos;
  if (!read_numeric(host, is_ipv6_, bytes_)) {
    fail(text, "not a range of addresses; write 192.168.1.7, 192.168.1.0/24 or 2001:db8::/32");
  }
  const int all_bits = is_ipv6_ ? 128 : 32;
  bits_ = all_bits;
  if (slash != std::string_view::npos) {
    const std::string_view digits = text.substr(slash + 1);
    const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), bits_);
    if (error != std::errc{} || stop != digits.data() + digits.size() || digits.front() == '-' ||
        bits_ > all_bits) {
      fail(text, "the length after '/' must be 0 to " + std::to_string(all_bits) + " bits");
    }
  }
  for (int bit = bits_; bit < all_bits; ++bit) {
    if (bit_of(bytes_, bit)) {
      fail(text, "bits beyond the first " + std::to_string(bits_) +
                     " are set; make them zero, or give a longer length after '/'");
    }
  }
}

bool AddressRange::contains(const Address& address) const noexcept {
  if (address.is_ipv6 != is_ipv6_) {
    return false;
  }
  for (int bit = 0; bit < bits_; ++bit) {
    if (bit_of(bytes_, bit) != bit_of(address.bytes, bit)) {
      return false;
    }
  }
  return true;
}

std::string to_string(const Address& address) {
  char host[INET6_ADDRSTRLEN] = "?";
  ::inet_ntop(address.is_ipv6 ? AF_INET6 : AF_INET, address.bytes.data(), host, sizeof host);
  std::string text = address.is_ipv6 ? "[" : "";
  text += host;
  text += address.is_ipv6 ? "]:" : ":";
  text += std::to_string(address.port);
  return text;
}

}  // namespace forcegrid::link
