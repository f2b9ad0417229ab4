// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <HD/hdDefines.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "compat/openhaptics/arm_facts.h"
#include "compat/openhaptics/device_table.h"
#include "compat/openhaptics/frame_rule.h"
#include "compat/openhaptics/parameters.h"
#include "device_session/device_session.h"

namespace forcegrid::openhaptics {

/// A capability by its place in Arm; nothing for a value that is none.
std::optional<std::size_t> capability_index(HDenum name) noexcept;

/// One open device: its frames, its capabilities, and the forces of the present tick.
///
/// Frames of the servo thread and of all other threads are two things: a program's own thread that
/// reads does not change what a callback sees.
///
/// A frame that the servo thread's callbacks have not ended ends with their tick.
///
/// Errors of a call are returned, or pushed for the calling thread where the text says so.
/// Real-time: everything but the constructor neither allocates nor throws. Threads: one at a time.
class Arm {
 public:
  static constexpr std::size_t kCapabilities = 8;

  /// @param with_method the session renders samples (push_sample) instead of forces.
  /// @param longest_callback as SessionOptions has it. @param hold of a force.
  Arm(HHD handle, DeviceEntry entry, std::shared_ptr<session::DeviceSession> session,
      bool with_method, rt::Duration longest_callback, rt::Duration hold);

  [[nodiscard]] HHD handle() const noexcept { return handle_; }
  [[nodiscard]] const DeviceEntry& entry() const noexcept { return entry_; }
  [[nodiscard]] const ArmFacts& facts() const noexcept { return facts_; }
  [[nodiscard]] const std::shared_ptr<session::DeviceSession>& session() const noexcept {
    return session_;
  }

  void begin_frame(bool in_servo_thread) noexcept;
  /// Pushes HD_EXCEEDED_MAX_FORCE once per excursion if clamping is off.
  /// @returns HD_SUCCESS or HD_ILLEGAL_END.
  HDerror end_frame(bool in_servo_thread) noexcept;
  [[nodiscard]] Reading read(Moment moment, bool in_servo_thread) const noexcept;
  /// @param values finite. @returns HD_SUCCESS, HD_FRAME_ERROR or HD_INVALID_VALUE.
  HDerror set(const Parameter& parameter, const double* values, bool in_servo_thread) noexcept;

  [[nodiscard]] bool is_enabled(std::size_t capability) const noexcept {
    return enabled_[capability];
  }
  /// @param may_flow the scheduler runs.
  void enable(std::size_t capability, bool on, bool may_flow) noexcept;
  /// The scheduler starts or stops: forces flow only while it runs.
  void let_flow(bool may_flow) noexcept;
  [[nodiscard]] HDenum calibration() noexcept;

  // By the servo thread. tick_begins() and callback_ended() push errors.
  void tick_begins() noexcept;
  void callback_begins() noexcept { session_->busy(); }
  void callback_ended(bool recurring, rt::Duration took) noexcept;
  void tick_ended() noexcept;

 private:
  struct Frame {
    int depth = 0;
    bool set_force = false;
    std::array<double, 3> force_D_N{};
    std::array<double, 3> torque_D_Nm{};
    session::ToolState state;  ///< of this frame
    session::ToolState last;   ///< of the one before
  };

  void complete(Frame& frame, bool in_callback) noexcept;
  [[nodiscard]] session::ToolState latch() const noexcept;
  [[nodiscard]] std::array<double, 3> clamped(const std::array<double, 3>& force_D_N) noexcept;
  void send(const FrameForce& force) noexcept;

  HHD handle_;
  DeviceEntry entry_;
  std::shared_ptr<session::DeviceSession> session_;
  ArmFacts facts_;
  bool with_method_;
  rt::Duration longest_callback_;
  rt::Duration hold_;

  std::array<Frame, 2> frames_{};           ///< [1] of the servo thread
  std::array<double, 3> last_force_D_N_{};  ///< of the last completed frame
  std::array<double, 3> last_torque_D_Nm_{};
  session::ToolState tick_state_;
  session::ToolState state_before_tick_;
  FrameRule rule_;
  ArmSettings settings_;
  std::array<bool, kCapabilities> enabled_{};
  bool flowing_ = false;         ///< the session's forces are on
  bool zero_is_due_ = false;     ///< what was set before force went off must not come back
  bool lost_ = false;            ///< its error has been posted
  bool shut_ = false;            ///< since then force was not switched off by the program
  bool beyond_maximum_ = false;  ///< the program's force is
  bool was_calibrated_ = true;
  FrameForce last_sample_{};
  bool has_sample_ = false;
};

}  // namespace forcegrid::openhaptics
