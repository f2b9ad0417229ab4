// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "link/address.h"
#include "link/key.h"
#include "link/sealed_channel.h"
#include "link/statistics.h"
#include "link/udp_socket.h"
#include "link/wire.h"

namespace forcegrid::link {

/// One end's socket, with datagrams as they are or, with keys, sealed.
/// Threads: one at a time.
class Transport {
 public:
  /// @param keys  none: datagrams are not sealed, and `local` has to be a loopback address
  /// @throws LinkError for an address that can't be used or keys that can't.
  Transport(LinkEnd own_end, const Address& local, std::vector<LinkKey> keys);

  [[nodiscard]] UdpSocket& socket() noexcept { return socket_; }
  [[nodiscard]] const UdpSocket& socket() const noexcept { return socket_; }

  /// Sends a message that encode() has written, sealed for `peer` if there are keys.
  /// Real-time: does not block; no allocation or throw.
  SendStatus send(const Address& to, const SealedPeer& peer, const Encoded& encoded,
                  std::span<const std::byte> buffer, LinkStatistics& statistics) noexcept;

  /// A datagram that has passed the key's checks.
  struct Incoming {
    std::span<const std::byte> datagram;  ///< within the buffer given
    SealedPeer peer;                      ///< whom to seal answers for; with keys only
    std::optional<RoundTrip> times;       ///< with keys only
  };
  /// Opens what the socket received into `buffer`. A datagram that can't be opened is counted. A
  /// hello is counted and leaves an empty `datagram` with its peer and times. A simulator's end
  /// replies to an authentic but stale datagram with a hello, which is no longer than that
  /// datagram.
  /// Real-time: some us; does not block; no allocation or throw.
  [[nodiscard]] std::optional<Incoming> open(const UdpSocket::Received& received,
                                             std::span<std::byte> buffer,
                                             LinkStatistics& statistics) noexcept;

 private:
  LinkEnd own_end_;
  std::optional<SealedChannel> channel_;
  UdpSocket socket_;
};

/// What parse_address() must allow for an end with or without keys.
constexpr Reach reach_with(const std::vector<LinkKey>& keys) noexcept {
  return keys.empty() ? Reach::kLoopback : Reach::kNetwork;
}

}  // namespace forcegrid::link
