// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "driver/device_url.h"
#include "rt/clock.h"

namespace forcegrid::driver {

/// A socket that closes itself.
class Socket {
 public:
  Socket() = default;
  explicit Socket(int descriptor) : descriptor_(descriptor) {}
  Socket(Socket&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  Socket& operator=(Socket&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  ~Socket() { close(); }
  void close() noexcept;
  int get() const noexcept { return descriptor_; }

 private:
  int descriptor_ = -1;
};

/// What wait_either() has ended with.
enum class Ready : std::uint8_t { kSocket, kOther, kTimeout };

/// Waits until `socket` is ready for `events` of poll(), `other` (unless negative) can be read, or
/// `deadline`. Real-time: blocks until then.
Ready wait_either(int socket, short events, int other, rt::TimePoint deadline) noexcept;

/// The same for one socket. @returns false at `deadline`.
bool wait_ready(int socket, short events, rt::TimePoint deadline) noexcept;

/// Connects to the host and port of `url`, without Nagle's delay. The socket does not block.
/// @throws DeviceError naming the URL, the system's words and the remedy.
Socket connect_to(const DeviceUrl& url, rt::TimePoint deadline);

/// @throws DeviceError, always: "device 'URL': problem".
[[noreturn]] void fail_open(const DeviceUrl& url, const std::string& problem);

}  // namespace forcegrid::driver
