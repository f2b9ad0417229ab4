// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <variant>

#include "link/messages.h"
#include "link/surface_patch.h"
#include "rt/clock.h"

namespace forcegrid::simulator {

/// How badly a network carries the simulator's datagrams.
struct LinkConditions {
  double delay_s = 0.0;   ///< of every datagram; 0 to kMostDelay_s
  double jitter_s = 0.0;  ///< further delay, uniform from 0 to this; may change their order
  double loss = 0.0;      ///< share of datagrams that are lost, each on its own; 0 to 1

  static constexpr double kMostDelay_s = 10.0;

  /// Whether each is finite and in its range.
  [[nodiscard]] bool usable() const noexcept;
  bool operator==(const LinkConditions&) const = default;
};

/// Delays and loses the datagrams of a simulator on their way to the servo, as a bad network does.
/// It imitates that at the simulator's end, so that the servo's threads have no part in it.
///
/// Real-time: no. Threads: one.
class ImpairedLink {
 public:
  using Message = std::variant<link::ForceSample, link::SurfacePatch, link::OtherTools>;
  using Send = std::function<void(const Message&)>;

  /// @param send  hands a datagram over to the socket. @param seed  of jitter and loss.
  ImpairedLink(Send send, const LinkConditions& conditions, std::uint64_t seed);

  /// For datagrams from now on; those on their way arrive as they would have. Usable conditions.
  void set(const LinkConditions& conditions) noexcept { conditions_ = conditions; }
  [[nodiscard]] const LinkConditions& conditions() const noexcept { return conditions_; }

  /// At once if nothing delays it.
  void send(const Message& message, rt::TimePoint now);
  /// Sends what has arrived by `now`.
  void send_due(rt::TimePoint now);
  /// When the next one arrives; nothing: none is on its way.
  [[nodiscard]] std::optional<rt::TimePoint> next() const noexcept;
  /// Forgets those on their way: the servo has gone.
  void clear() noexcept { waiting_.clear(); }

  struct Counts {
    std::uint64_t delayed = 0;
    std::uint64_t lost = 0;
  };
  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  Send send_;
  LinkConditions conditions_;
  std::mt19937_64 random_;
  std::multimap<rt::TimePoint, Message> waiting_;  // by the time of arrival
  Counts counts_;
};

}  // namespace forcegrid::simulator
