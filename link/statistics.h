// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "link/seal.h"
#include "link/wire.h"

namespace forcegrid::link {
#pragma GCC visibility push(default)

/// What became of one send().
enum class SendStatus : std::uint8_t {
  kSent,          ///< handed to the system (UDP promises no more)
  kInvalid,       ///< not sent: not finite or out of range, see wire.h
  kNotRising,     ///< not sent: sequence or query id does not follow the one before
  kNoPeer,        ///< nobody listens at the peer's address, or no servo has been heard yet
  kSystemFailed,  ///< the system refused; LinkStatistics::last_send_errno says why
};

/// Static text in lower case, e.g. "nobody listens there".
const char* to_string(SendStatus status) noexcept;

/// Counted by one end of the link since it was opened. Every datagram that arrives is counted in
/// `received` and in exactly one of `accepted`, `hellos` and the parts of dropped(); a goodbye of
/// the peer counts as accepted.
struct LinkStatistics {
  std::uint64_t sent = 0;
  std::uint64_t send_invalid = 0;  ///< SendStatus::kInvalid and kNotRising
  std::uint64_t send_no_peer = 0;  ///< nobody listened: kNoPeer, or sent and came back
  std::uint64_t send_failed = 0;   ///< SendStatus::kSystemFailed
  int last_send_errno = 0;         ///< of the newest kSystemFailed

  std::uint64_t received = 0;
  std::uint64_t accepted = 0;
  std::uint64_t hellos = 0;  ///< sealed and empty: announced the peer's stream
  std::uint64_t not_allowed =
      0;  ///< from an address that --allow leaves out (simulator's end only)
  /// By SealStatus, with a key only; [kOk] and [kHello] stay 0.
  std::array<std::uint64_t, kSealStatusCount> seal_refused{};
  std::array<std::uint64_t, kWireStatusCount> malformed{};  ///< by WireStatus; [kOk] stays 0
  std::uint64_t foreign_address = 0;  ///< not from the peer's address and port
  std::uint64_t foreign_session = 0;  ///< of another run: stale or invented
  std::uint64_t unexpected_type = 0;  ///< a message that only this side sends
  std::uint64_t forged = 0;           ///< echoes something that was never sent (servo's end only)
  std::uint64_t late = 0;             ///< older than the newest accepted
  std::uint64_t duplicated = 0;       ///< seen before
  std::uint64_t overflowed = 0;  ///< queries beyond what the queue holds (simulator's end only)

  // From sequence numbers; not part of the sum above.
  std::uint64_t lost = 0;        ///< numbers of the peer's sequence that have not arrived (yet)
  std::uint64_t reordered = 0;   ///< arrived after a datagram with a higher number
  std::uint64_t superseded = 0;  ///< tool states skipped for a newer one (simulator's end only)
  std::uint64_t restarts = 0;    ///< sessions after the first; servo: restarts of the simulator
  std::uint64_t overrun = 0;     ///< arrived while the system's buffer was full; not in `received`

  /// Sum of `malformed`. Real-time: yes.
  [[nodiscard]] std::uint64_t malformed_total() const noexcept;
  /// Sum of `seal_refused`. Real-time: yes.
  [[nodiscard]] std::uint64_t seal_refused_total() const noexcept;
  /// Everything received that is neither accepted nor a hello. Real-time: yes.
  [[nodiscard]] std::uint64_t dropped() const noexcept;
};

/// Why datagrams were dropped, and how many for each reason that occurred; the numbers add up to
/// dropped(). Real-time: no (allocates).
std::vector<std::pair<std::string, std::uint64_t>> drop_reasons(const LinkStatistics& statistics);

/// The same for people: "12 forged, 3 stale". Real-time: no (allocates).
std::string drop_text(const LinkStatistics& statistics);

#pragma GCC visibility pop
}  // namespace forcegrid::link
