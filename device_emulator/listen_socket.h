// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

namespace forcegrid::emulator {

#pragma GCC visibility push(default)
/// The emulator can't be set up. `what()` says why and how to fix it.
class EmulatorError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
#pragma GCC visibility pop

/// Where to listen. Loopback only.
struct ListenAddress {
  std::string address;  ///< numeric, without brackets
  std::uint16_t port = 0;
  bool ipv6 = false;
  /// "127.0.0.1:3240" or "[::1]:3240".
  [[nodiscard]] std::string text() const;
};

/// "ADDR:PORT" with ADDR an IPv4 address in 127.0.0.0/8, "[::1]" or "localhost", and PORT 0 (any
/// free one) to 65535.
/// @throws EmulatorError for anything else; for an address that is not loopback it gives the
///   reason.
ListenAddress parse_listen_address(std::string_view text);

/// A file descriptor that closes itself.
class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) noexcept : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor();
  [[nodiscard]] int get() const noexcept { return fd_; }

 private:
  int fd_;
};

/// Opens a non-blocking TCP socket that listens at `where`.
/// @param bound_port the port that was bound, which differs from where.port if that is 0.
/// @throws EmulatorError naming the address, the system's words and the remedy.
FileDescriptor listen_on(const ListenAddress& where, std::uint16_t& bound_port);

}  // namespace forcegrid::emulator
