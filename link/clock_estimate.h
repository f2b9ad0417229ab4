// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace forcegrid::link {

/// One datagram to the peer and one back: two times by this end's clock, two by the peer's.
struct RoundTrip {
  std::int64_t sent_ns = 0;           ///< own clock: this end sent
  std::int64_t peer_received_ns = 0;  ///< peer's clock: the peer received
  std::int64_t peer_sent_ns = 0;      ///< peer's clock: the peer sent
  std::int64_t received_ns = 0;       ///< own clock: this end received
};

/// How the peer's clock differs from ours.
struct ClockEstimate {
  bool known = false;
  double offset_s = 0.0;  ///< peer's clock minus ours; right to within round_trip_s / 2
  double round_trip_s =
      0.0;  ///< of the round trip that the offset is from, without the peer's wait
};

/// Estimates the peer's clock from the quickest of the newest kWindow round trips:
///
///   round trip = (received - sent) - (peer_sent - peer_received)
///   offset     = ((peer_received - sent) + (peer_sent - received)) / 2
///
/// The error is half the difference between the two ways, so at most half the round trip, plus what
/// the clocks drift within the window (some us in 2 s).
/// Source: RFC 5905 (NTP), sections 8 and 10.
/// Real-time: bounded, no allocation, lock or throw. Threads: one.
class ClockFilter {
 public:
  static constexpr std::size_t kWindow = 64;  ///< two seconds of a simulator at 30 Hz

  /// Ignores a round trip that ran backwards (the peer's times are nonsense).
  void add(const RoundTrip& times) noexcept;
  [[nodiscard]] ClockEstimate estimate() const noexcept;
  void reset() noexcept { count_ = 0; }

 private:
  struct Entry {
    double round_trip_s;
    double offset_s;
  };
  std::array<Entry, kWindow> entries_{};
  std::size_t count_ = 0;
};

}  // namespace forcegrid::link
