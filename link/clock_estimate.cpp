// SPDX-License-Identifier: Apache-2.0
#include "link/clock_estimate.h"

#include <algorithm>

namespace forcegrid::link {
namespace {

double seconds_between(std::int64_t from_ns, std::int64_t to_ns) noexcept {
  return 1e-9 * (static_cast<double>(to_ns) - static_cast<double>(from_ns));
}

}  // namespace

void ClockFilter::add(const RoundTrip& times) noexcept {
  const double out_and_back_s = seconds_between(times.sent_ns, times.received_ns);
  const double peer_wait_s = seconds_between(times.peer_received_ns, times.peer_sent_ns);
  if (peer_wait_s < 0.0 || out_and_back_s < peer_wait_s) {
    return;
  }
  entries_[count_ % kWindow] = {out_and_back_s - peer_wait_s,
                                0.5 * (seconds_between(times.sent_ns, times.peer_received_ns) +
                                       seconds_between(times.received_ns, times.peer_sent_ns))};
  ++count_;
}

ClockEstimate ClockFilter::estimate() const noexcept {
  if (count_ == 0) {
    return {};
  }
  const auto end = entries_.begin() + static_cast<std::ptrdiff_t>(std::min(count_, kWindow));
  const auto quickest = std::min_element(entries_.begin(), end, [](const Entry& a, const Entry& b) {
    return a.round_trip_s < b.round_trip_s;
  });
  return {true, quickest->offset_s, quickest->round_trip_s};
}

}  // namespace forcegrid::link
