// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/arm.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <utility>

#include "compat/openhaptics/error_stack.h"

namespace forcegrid::openhaptics {
namespace {

using session::SessionHealth;
using session::ToolState;

constexpr std::array<HDenum, Arm::kCapabilities> kNames = {HD_FORCE_OUTPUT,
                                                           HD_MAX_FORCE_CLAMPING,
                                                           HD_FORCE_RAMPING,
                                                           HD_SOFTWARE_FORCE_LIMIT,
                                                           HD_ONE_FRAME_LIMIT,
                                                           HD_SOFTWARE_VELOCITY_LIMIT,
                                                           HD_SOFTWARE_FORCE_IMPULSE_LIMIT,
                                                           HD_USER_STATUS_LIGHT};
constexpr std::size_t kForceOutput = 0;
constexpr std::size_t kClamping = 1;

// A force that is only repeated is no new answer of the object, except that after this time the
// method should know that it still holds.
constexpr std::int64_t kRepeat_ns = 33'000'000;

bool is_finite(const std::array<double, 3>& three) noexcept {
  return std::isfinite(three[0]) && std::isfinite(three[1]) && std::isfinite(three[2]);
}

bool is_gone(SessionHealth health) noexcept {
  return health == SessionHealth::kLost || health == SessionHealth::kFaulted ||
         health == SessionHealth::kClosed;
}

}  // namespace

std::optional<std::size_t> capability_index(HDenum name) noexcept {
  const auto* const found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) {
    return std::nullopt;
  }
  return static_cast<std::size_t>(found - kNames.begin());
}

Arm::Arm(HHD handle, DeviceEntry entry, std::shared_ptr<session::DeviceSession> session,
         bool with_method, rt::Duration longest_callback, rt::Duration hold)
    : handle_(handle),
      entry_(std::move(entry)),
      session_(std::move(session)),
      facts_(facts_of(*session_, entry_)),
      with_method_(with_method),
      longest_callback_(longest_callback),
      hold_(hold) {
  enabled_.fill(true);
  enabled_[kForceOutput] = false;
  tick_state_ = state_before_tick_ = latch();
  for (Frame& frame : frames_) {
    frame.state = tick_state_;
  }
}

ToolState Arm::latch() const noexcept {
  ToolState state = session_->newest_state();
  if (is_gone(session_->health())) {
    state.velocity_D_m_per_s = {};
    state.angular_velocity_D_rad_per_s = {};
    state.buttons = 0;
  }
  return state;
}

void Arm::begin_frame(bool in_servo_thread) noexcept {
  Frame& frame = frames_[in_servo_thread ? 1 : 0];
  if (frame.depth++ > 0) {
    return;
  }
  frame.last = frame.state;
  frame.state = latch();
  frame.set_force = false;
  frame.force_D_N = frame.torque_D_Nm = {};
}

HDerror Arm::end_frame(bool in_servo_thread) noexcept {
  Frame& frame = frames_[in_servo_thread ? 1 : 0];
  if (frame.depth == 0) {
    return HD_ILLEGAL_END;
  }
  if (--frame.depth == 0) {
    complete(frame, in_servo_thread);
  }
  return HD_SUCCESS;
}

void Arm::complete(Frame& frame, bool in_callback) noexcept {
  if (frame.set_force) {
    frame.force_D_N = clamped(frame.force_D_N);
  }
  last_force_D_N_ = frame.force_D_N;
  last_torque_D_Nm_ = frame.torque_D_Nm;
  rule_.frame_ended(
      in_callback, frame.set_force,
      {frame.force_D_N, frame.state.position_D_m, frame.state.time_ns, frame.torque_D_Nm});
}

std::array<double, 3> Arm::clamped(const std::array<double, 3>& force_D_N) noexcept {
  const double size_N = std::hypot(force_D_N[0], force_D_N[1], force_D_N[2]);
  const bool beyond = size_N > facts_.max_force_N;
  if (beyond && !beyond_maximum_ && !enabled_[kClamping]) {
    push_error(HD_EXCEEDED_MAX_FORCE, handle_);
  }
  beyond_maximum_ = beyond;
  std::array<double, 3> result = force_D_N;
  if (beyond) {
    for (double& axis : result) {
      axis *= facts_.max_force_N / size_N;
    }
  }
  return result;
}

Reading Arm::read(Moment moment, bool in_servo_thread) const noexcept {
  const Frame& frame = frames_[in_servo_thread ? 1 : 0];
  Reading reading;
  reading.facts = &facts_;
  reading.settings = &settings_;
  if (moment == Moment::kLast) {
    reading.state = frame.depth > 0 ? frame.last : state_before_tick_;
    reading.force_D_N = last_force_D_N_;
    reading.torque_D_Nm = last_torque_D_Nm_;
  } else if (moment == Moment::kCurrent) {
    reading.state = frame.depth > 0 ? frame.state : latch();
    reading.force_D_N = frame.depth > 0 ? frame.force_D_N : last_force_D_N_;
    reading.torque_D_Nm = frame.depth > 0 ? frame.torque_D_Nm : last_torque_D_Nm_;
  }
  return reading;
}

HDerror Arm::set(const Parameter& parameter, const double* values, bool in_servo_thread) noexcept {
  Frame& frame = frames_[in_servo_thread ? 1 : 0];
  switch (parameter.setting) {
    case Setting::kForce:
    case Setting::kJointTorque: {
      if (frame.depth == 0) {
        return HD_FRAME_ERROR;
      }
      const std::array<double, 3> three = {values[0], values[1], values[2]};
      const std::array<double, 3> force_D_N =
          parameter.setting == Setting::kForce
              ? to_device(three)
              : force_of_joint_torque_D(facts_, frame.state, three);
      if (!is_finite(force_D_N)) {
        return HD_INVALID_VALUE;
      }
      frame.force_D_N = force_D_N;
      frame.set_force = true;
      return HD_SUCCESS;
    }
    case Setting::kTorque: {
      if (!facts_.has_wrist_motors) {
        return HD_SUCCESS;  // programs set it in every tick, whatever the device
      }
      if (frame.depth == 0) {
        return HD_FRAME_ERROR;
      }
      const std::array<double, 3> torque_D_mNm = to_device({values[0], values[1], values[2]});
      for (std::size_t i = 0; i < 3; ++i) {
        frame.torque_D_Nm[i] = torque_D_mNm[i] / kMm_per_m;
      }
      frame.set_force = true;
      return HD_SUCCESS;
    }
    case Setting::kLimit:
      if (!(values[0] >= 0.0)) {
        return HD_INVALID_VALUE;
      }
      (parameter.name == HD_SOFTWARE_VELOCITY_LIMIT        ? settings_.velocity_limit_mm_per_s
       : parameter.name == HD_SOFTWARE_FORCE_IMPULSE_LIMIT ? settings_.impulse_limit
                                                           : settings_.ramping_rate) = values[0];
      return HD_SUCCESS;
    case Setting::kLight:
      settings_.light = static_cast<int>(values[0]) & LED_MASK;
      return HD_SUCCESS;
    default:
      return HD_SUCCESS;
  }
}

void Arm::enable(std::size_t capability, bool on, bool may_flow) noexcept {
  const bool was_on = enabled_[capability];
  enabled_[capability] = on;
  if (capability != kForceOutput || was_on == on) {
    return;
  }
  if (!on) {
    shut_ = false;
  }
  let_flow(may_flow);
}

void Arm::let_flow(bool may_flow) noexcept {
  const bool flow = may_flow && enabled_[kForceOutput] && !shut_;
  if (flow != flowing_) {
    flowing_ = flow;
    zero_is_due_ = true;
    has_sample_ = false;
    rule_.clear();
    session_->enable_force(flow);
  }
}

HDenum Arm::calibration() noexcept {
  const SessionHealth health = session_->health();
  if (!is_gone(health)) {
    was_calibrated_ = health != SessionHealth::kUncalibrated;
  }
  return was_calibrated_ ? HD_CALIBRATION_OK : HD_CALIBRATION_NEEDS_MANUAL_INPUT;
}

void Arm::tick_begins() noexcept {
  state_before_tick_ = tick_state_;
  tick_state_ = latch();
  const SessionHealth health = session_->health();
  const bool lost = is_gone(health);
  if (lost != lost_) {  // what was enabled meanwhile meant the device as it was
    shut_ = enabled_[kForceOutput];
    let_flow(true);
  }
  if (lost && !lost_) {
    push_error(health == SessionHealth::kLost ? HD_COMM_ERROR : HD_DEVICE_FAULT, handle_,
               health == SessionHealth::kLost ? ENODEV : tick_state_.fault);
  }
  lost_ = lost;
}

void Arm::callback_ended(bool recurring, rt::Duration took) noexcept {
  session_->idle();
  rule_.callback_returned(recurring);
  if (took > longest_callback_ && flowing_) {
    push_error(HD_FORCE_ERROR, handle_, ETIMEDOUT);
  }
}

void Arm::tick_ended() noexcept {
  if (Frame& frame = frames_[1]; frame.depth > 0) {  // or its state would never change again
    frame.depth = 0;
    complete(frame, false);
  }
  const FrameRule::Command command = rule_.tick_ended();
  if (!flowing_) {
    return;
  }
  if (command.kind != FrameRule::Kind::kHold) {
    send(command.force);
  } else if (zero_is_due_) {
    session_->command_force({}, hold_);  // and no torque
  }
  zero_is_due_ = false;
}

void Arm::send(const FrameForce& force) noexcept {
  if (!with_method_) {
    session_->command_wrench(force.force_D_N, force.torque_D_Nm, hold_);
    return;
  }
  const bool is_new = !has_sample_ || force.force_D_N != last_sample_.force_D_N ||
                      force.time_ns - last_sample_.time_ns > kRepeat_ns;
  if (is_new && session_->push_sample(force.time_ns, force.position_D_m, force.force_D_N)) {
    last_sample_ = force;
    has_sample_ = true;
  }
}

}  // namespace forcegrid::openhaptics
