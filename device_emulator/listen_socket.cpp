// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/listen_socket.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>

namespace forcegrid::emulator {

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) {
    ::close(fd_);
  }
}

std::string ListenAddress::text() const {
  return (ipv6 ? "[" + address + "]" : address) + ":" + std::to_string(port);
}

ListenAddress parse_listen_address(std::string_view text) {
  const std::string quoted = "listen address '" + std::string(text) + "'";
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos || colon == 0) {
    throw EmulatorError(quoted + " is not ADDR:PORT; write for example 127.0.0.1:3240");
  }
  std::string_view host = text.substr(0, colon);
  const std::string_view port_text = text.substr(colon + 1);
  ListenAddress result;
  unsigned port = 0;
  const auto [end, error] =
      std::from_chars(port_text.data(), port_text.data() + port_text.size(), port);
  if (error != std::errc{} || end != port_text.data() + port_text.size() || port > 65535) {
    throw EmulatorError(quoted + ": port '" + std::string(port_text) +
                        "' is not a number from 0 to 65535 (0: any free port)");
  }
  result.port = static_cast<std::uint16_t>(port);

  const bool bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (bracketed) {
    host = host.substr(1, host.size() - 2);
  }
  result.address = host == "localhost" ? "127.0.0.1" : std::string(host);
  in_addr ipv4{};
  in6_addr ipv6{};
  bool loopback = false;
  if (!bracketed && ::inet_pton(AF_INET, result.address.c_str(), &ipv4) == 1) {
    loopback = (ntohl(ipv4.s_addr) >> 24) == 127;
  } else if (bracketed && ::inet_pton(AF_INET6, result.address.c_str(), &ipv6) == 1) {
    result.ipv6 = true;
    loopback = IN6_IS_ADDR_LOOPBACK(&ipv6);
  } else {
    throw EmulatorError(quoted + ": '" + std::string(host) +
                        "' is not a numeric address; write 127.0.0.1, [::1] or localhost");
  }
  if (!loopback) {
    throw EmulatorError(quoted +
                        " is not loopback: USB/IP has neither authentication nor encryption, and "
                        "the device obeys whoever connects; use 127.0.0.1:" +
                        std::to_string(port) +
                        " and reach it from another machine through an SSH tunnel (ssh -L)");
  }
  return result;
}

FileDescriptor listen_on(const ListenAddress& where, std::uint16_t& bound_port) {
  const auto fail = [&](const char* call, const char* remedy) {
    const int error = errno;
    throw EmulatorError("listen address " + where.text() + ": " + call + " failed (" +
                        std::strerror(error) + ")" + remedy);
  };
  FileDescriptor socket(
      ::socket(where.ipv6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) {
    fail("socket", "");
  }
  const int on = 1;
  // Without it the system refuses the port for a minute after the last emulator on it has ended.
  if (::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0) {
    fail("setsockopt", "");
  }
  sockaddr_storage storage{};
  socklen_t size = 0;
  if (where.ipv6) {
    auto* address = reinterpret_cast<sockaddr_in6*>(&storage);
    address->sin6_family = AF_INET6;
    address->sin6_port = htons(where.port);
    ::inet_pton(AF_INET6, where.address.c_str(), &address->sin6_addr);
    size = sizeof *address;
  } else {
    auto* address = reinterpret_cast<sockaddr_in*>(&storage);
    address->sin_family = AF_INET;
    address->sin_port = htons(where.port);
    ::inet_pton(AF_INET, where.address.c_str(), &address->sin_addr);
    size = sizeof *address;
  }
  auto* generic = reinterpret_cast<sockaddr*>(&storage);
  if (::bind(socket.get(), generic, size) != 0) {
    fail("bind",
         errno == EADDRINUSE
             ? "; another emulator or usbipd holds the port: stop it, choose another port, "
               "or port 0 for any free one"
             : (errno == EACCES ? "; ports below 1024 need root: choose a higher one" : ""));
  }
  if (::listen(socket.get(), 128) != 0) {
    fail("listen",
         errno == EADDRINUSE ? "; another server holds the port: choose another one" : "");
  }
  if (::getsockname(socket.get(), generic, &size) != 0) {
    fail("getsockname", "");
  }
  bound_port = ntohs(where.ipv6 ? reinterpret_cast<sockaddr_in6*>(&storage)->sin6_port
                                : reinterpret_cast<sockaddr_in*>(&storage)->sin_port);
  return socket;
}

}  // namespace forcegrid::emulator
