// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "link/clock_estimate.h"
#include "link/key.h"
#include "link/replay_window.h"
#include "link/seal.h"

namespace forcegrid::link {

/// The peer to seal answers for, as open() found out.
struct SealedPeer {
  StreamId stream{};  ///< zero: not heard yet
  std::uint8_t key_index = 0;
  std::int64_t sent_ns = 0;      ///< by the peer's clock: when its newest datagram left
  std::int64_t received_ns = 0;  ///< by this end's: when it was taken in
};

/// Seals what one end sends and opens what it receives.
///
/// Freshness: every datagram names the newest stream that its sender has heard from the receiver,
/// and the receiver accepts only datagrams that name its own. That stream is random and as old as
/// this object, so nothing recorded earlier can pass, and ended sessions need no memory. Within a
/// stream a ReplayWindow lets each counter pass once. Up to kPeerStreams streams of peers are kept;
/// one more makes this end draw a new stream, and all older datagrams become stale. A servo has one
/// simulator: once that has shown a newer stream, its older ones are stale.
///
/// Real-time: open() and seal() cost some us, don't allocate, lock, block or throw.
/// Threads: one at a time.
class SealedChannel {
 public:
  static constexpr std::size_t kPeerStreams = 16;
  static constexpr std::size_t kMaxKeys = 8;

  /// @param keys  1 to kMaxKeys; all are accepted, the first is used until the peer shows another
  /// @throws LinkError for no key, too many, or two of the same id.
  SealedChannel(LinkEnd own_end, std::vector<LinkKey> keys);

  struct Opened {
    SealStatus status = SealStatus::kTooShort;
    SealedPeer peer;                    ///< with kOk, kHello, kStale and kReplayed
    std::span<const std::byte> inside;  ///< with kOk: where `sealed` was
    RoundTrip times;                    ///< with kOk and kHello
  };
  /// Checks and decrypts a datagram in place. Safe for any bytes of any length.
  /// @param now_ns  this end's monotonic clock
  [[nodiscard]] Opened open(std::span<std::byte> sealed, std::int64_t now_ns) noexcept;

  /// Writes the sealed form of `datagram`, which may be empty (a hello), to the front of `buffer`.
  /// @returns its size, 0 if `buffer` is too small.
  [[nodiscard]] std::size_t seal(const SealedPeer& peer, std::span<const std::byte> datagram,
                                 std::int64_t now_ns, std::span<std::byte> buffer) noexcept;

 private:
  struct PeerStream {
    StreamId id{};
    ReplayWindow window;
  };

  void begin_stream() noexcept;
  [[nodiscard]] SealStatus admit(const StreamId& stream, std::uint64_t counter) noexcept;

  LinkEnd own_end_;
  std::vector<LinkKey> keys_;
  StreamId own_stream_{};
  std::uint64_t counter_ = 0;
  std::array<PeerStream, kPeerStreams> peers_{};
  std::size_t peer_count_ = 0;
};

}  // namespace forcegrid::link
