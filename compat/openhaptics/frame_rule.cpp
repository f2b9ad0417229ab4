// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/frame_rule.h"

namespace forcegrid::openhaptics {

void FrameRule::frame_ended(bool in_callback, bool set_force, const FrameForce& frame) noexcept {
  if (set_force) {
    command_ = {Kind::kForce, frame};
  } else if (in_callback) {
    forceless_ = frame;
    forceless_->force_D_N = forceless_->torque_D_Nm = {};
  }
}

void FrameRule::callback_returned(bool recurring) noexcept {
  if (recurring && forceless_ && command_.kind != Kind::kForce) {
    command_ = {Kind::kZero, *forceless_};
  }
  forceless_.reset();
}

FrameRule::Command FrameRule::tick_ended() noexcept {
  const Command command = command_;
  command_ = {};
  return command;
}

}  // namespace forcegrid::openhaptics
