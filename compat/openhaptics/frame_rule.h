// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>

namespace forcegrid::openhaptics {

/// A force and a torque of the program, and where the tool was in the frame that set them.
struct FrameForce {
  std::array<double, 3> force_D_N{};
  std::array<double, 3> position_D_m{};
  std::int64_t time_ns = 0;             ///< CLOCK_MONOTONIC
  std::array<double, 3> torque_D_Nm{};  ///< about the tip
};

/// What one arm is told when all callbacks of a tick have run.
///
///   kForce  some frame set a force or a torque: the last one
///   kZero   no frame did, but a recurring callback completed one: the program wants no force
///   kHold   no frame, or only frames of synchronous and one-shot callbacks and of other threads:
///           the force before goes on, for as long as it was given
///
/// Real-time: neither allocates, locks nor throws. Threads: one at a time.
class FrameRule {
 public:
  enum class Kind : std::uint8_t { kForce, kZero, kHold };
  struct Command {
    Kind kind = Kind::kHold;
    FrameForce force{};  ///< with kZero: no force, and where the tool was
  };

  /// An outermost frame ended.
  /// @param in_callback by the servo thread's present callback; callback_returned() follows.
  /// @param set_force   it set `frame.force_D_N` or `frame.torque_D_Nm`.
  void frame_ended(bool in_callback, bool set_force, const FrameForce& frame) noexcept;
  /// @param recurring it runs in every tick: not a synchronous call, not done after its first run.
  void callback_returned(bool recurring) noexcept;
  /// The decision; then begins the next tick.
  Command tick_ended() noexcept;
  /// Forgets the tick's frames.
  void clear() noexcept { *this = {}; }

 private:
  Command command_{};
  std::optional<FrameForce> forceless_;  ///< of the present callback
};

}  // namespace forcegrid::openhaptics
