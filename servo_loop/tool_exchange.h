// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "rt/mailbox.h"
#include "servo_loop/cycle_record.h"

namespace forcegrid::servo {

/// Where a tool is, as its servo loop tells another loop of the same program in each cycle.
struct ToolPlace {
  Triple position_W_m{};
  std::int64_t time_ns = 0;  ///< CLOCK_MONOTONIC of the cycle that read it
  Triple force_W_N{};        ///< between the two tools, on this one, without either hand's gain
  double gain = 0.0;         ///< share of a wanted force that its hand gets now, 0..1
  double given_J = 0.0;      ///< what the force between the two tools has given to its hand
};

/// Mailboxes between the servo loops of one program, one for each ordered pair. W is the same for
/// all. Real-time: wait-free, no allocation, lock or throw. Threads: each loop publishes as `from`
/// and fetches as `to`, on its own.
class ToolExchange {
 public:
  static constexpr std::size_t kMostTools = 4;

  /// @param tools  2 to kMostTools
  explicit ToolExchange(std::size_t tools) noexcept : tools_(tools) {}

  [[nodiscard]] std::size_t tools() const noexcept { return tools_; }
  void publish(std::size_t from, std::size_t to, const ToolPlace& place) noexcept {
    boxes_[from][to].publish(place);
  }
  /// False leaves `place` untouched: nothing new has come.
  [[nodiscard]] bool fetch(std::size_t to, std::size_t from, ToolPlace& place) noexcept {
    return boxes_[from][to].fetch(place);
  }

 private:
  std::size_t tools_;
  std::array<std::array<rt::Mailbox<ToolPlace>, kMostTools>, kMostTools> boxes_;
};

}  // namespace forcegrid::servo
