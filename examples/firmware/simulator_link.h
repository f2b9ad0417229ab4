// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "examples/firmware/serial_frames.h"
#include "forcegrid/core/force_method.h"

namespace forcegrid::firmware {

/// The servo's side of the link to a simulator, docs/link_protocol.md, one datagram in a frame.
/// Real-time: no allocation, lock or throw. Threads: one.
class SimulatorLink {
 public:
  static constexpr std::size_t kToolStateBytes = 84, kForceSampleBytes = 212;
  using ToolStateBytes = std::array<std::uint8_t, kToolStateBytes>;

  /// @param session of this run, not 0.
  explicit SimulatorLink(std::uint64_t session) noexcept : session_(session) {}

  /// The next tool state.
  /// @param time_ns of the device's clock. @param position_W [m] @param velocity_W [m/s]
  ToolStateBytes tool_state(std::int64_t time_ns, const Eigen::Vector3d& position_W,
                            const Eigen::Vector3d& velocity_W) noexcept;

  /// A sample as it arrived.
  struct Arrived {
    Sample sample;
    bool in_contact = false;
  };
  /// Decodes a datagram. @returns nothing unless it is a whole force sample of this session that is
  /// newer than those before, finite and within the protocol's bounds; then it counts as dropped.
  std::optional<Arrived> sample(std::span<const std::uint8_t> datagram) noexcept;
  std::uint32_t dropped() const noexcept { return dropped_; }

 private:
  std::uint64_t session_;
  std::uint32_t sent_ = 0;
  std::uint32_t newest_ = 0;
  std::uint32_t dropped_ = 0;
};

}  // namespace forcegrid::firmware
