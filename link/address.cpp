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
    fail(text, "port 0 is no port to send to; give the port at which the simulator listens");
  }
  return static_cast<std::uint16_t>(port);
}

bool is_loopback(const Address& address) {
  if (!address.is_ipv6) {
    return address.bytes[0] == kIpv4LoopbackNet;
  }
  return std::all_of(address.bytes.begin(), address.bytes.end() - 1,
                     [](std::uint8_t byte) { return byte == 0; }) &&
         address.bytes.back() == 1;
}

}  // namespace

Address parse_address(std::string_view text, PortZero port_zero) {
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
  // inet_pton reads a C string: a byte 0 inside would hide what follows it.
  if (host.find('\0') != std::string::npos ||
      ::inet_pton(address.is_ipv6 ? AF_INET6 : AF_INET, host.c_str(), address.bytes.data()) != 1) {
    fail(
        text,
        "not a numeric IP address; write 127.0.0.1:PORT, [::1]:PORT or localhost:PORT (other names "
        "are not looked up)");
  }
  if (!is_loopback(address)) {
    fail(text,
         "not a loopback address; the link's datagrams are not authenticated, so anyone who could "
         "reach the socket could move the motors, and a link to another machine needs a key, which "
         "this version does not have. Run the simulator on the servo's machine and use "
         "127.0.0.1:PORT");
  }
  address.port = parse_port(text, text.substr(colon + 1), port_zero);
  return address;
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
