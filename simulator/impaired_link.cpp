// SPDX-License-Identifier: Apache-2.0
#include "simulator/impaired_link.h"

#include <utility>

namespace forcegrid::simulator {

bool LinkConditions::usable() const noexcept {
  return delay_s >= 0.0 && delay_s <= kMostDelay_s && jitter_s >= 0.0 && jitter_s <= kMostDelay_s &&
         loss >= 0.0 && loss <= 1.0;
}

ImpairedLink::ImpairedLink(Send send, const LinkConditions& conditions, std::uint64_t seed)
    : send_(std::move(send)), conditions_(conditions), random_(seed) {}

void ImpairedLink::send(const Message& message, rt::TimePoint now) {
  std::uniform_real_distribution<double> share(0.0, 1.0);
  if (conditions_.loss > 0.0 && share(random_) < conditions_.loss) {
    ++counts_.lost;
    return;
  }
  double delay_s = conditions_.delay_s;
  if (conditions_.jitter_s > 0.0) {
    delay_s += conditions_.jitter_s * share(random_);
  }
  if (delay_s <= 0.0) {
    send_(message);
    return;
  }
  ++counts_.delayed;
  waiting_.emplace(now + rt::from_seconds(delay_s), message);
}

void ImpairedLink::send_due(rt::TimePoint now) {
  while (!waiting_.empty() && waiting_.begin()->first <= now) {
    const Message message = waiting_.begin()->second;
    waiting_.erase(waiting_.begin());
    send_(message);
  }
}

std::optional<rt::TimePoint> ImpairedLink::next() const noexcept {
  return waiting_.empty() ? std::nullopt : std::optional(waiting_.begin()->first);
}

}  // namespace forcegrid::simulator
