// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>

#include "link/address.h"

namespace forcegrid::link {

/// A non-blocking UDP socket. It is not connected, so that datagrams from a wrong
/// address can be counted instead of vanishing in the kernel; ports without a listener are
/// reported all the same (IP_RECVERR).
/// Threads: one at a time.
class UdpSocket {
 public:
  /// Binds to `local`, with port 0 to a free port.
  /// @throws LinkError naming the address, the system's reason and the remedy.
  explicit UdpSocket(const Address& local);
  ~UdpSocket();
  UdpSocket(const UdpSocket&) = delete;
  UdpSocket& operator=(const UdpSocket&) = delete;

  [[nodiscard]] const Address& local_address() const noexcept { return local_; }

  /// @returns 0, or the system's errno (a pending "nobody listens" of an earlier datagram is taken
  ///   in first and does not stop this one).
  /// Real-time: does not block.
  int send_to(const Address& peer, std::span<const std::byte> datagram) noexcept;

  struct Received {
    enum class Kind : std::uint8_t { kNothing, kDatagram } kind = Kind::kNothing;
    std::size_t size_bytes = 0;  ///< true size, which may exceed the buffer's
    Address sender;
  };
  /// The next datagram, if one has arrived. Real-time: does not block.
  [[nodiscard]] Received receive(std::span<std::byte> buffer) noexcept;

  enum class Wait : std::uint8_t { kReadable, kTimeout, kInterrupted };
  /// Blocks until something can be received, `timeout` has passed or a signal came.
  Wait wait(std::chrono::nanoseconds timeout) noexcept;

  /// Datagrams that the system has dropped since the start because this end read too slowly, as of
  /// the newest that was received.
  [[nodiscard]] std::uint32_t overrun() const noexcept { return overrun_; }

  /// Datagrams that came back since the start because nobody listened at their destination.
  [[nodiscard]] std::uint64_t undelivered() const noexcept { return undelivered_; }

 private:
  void take_in_errors() noexcept;

  int descriptor_ = -1;
  Address local_;
  std::uint64_t undelivered_ = 0;
  std::uint32_t overrun_ = 0;
};

}  // namespace forcegrid::link
