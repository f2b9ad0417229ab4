// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/degradation_ladder.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace forcegrid::servo {

const char* to_string(Rung rung) noexcept {
  switch (rung) {
    case Rung::kFresh:
      return "fresh sample";
    case Rung::kOld:
      return "old sample";
    case Rung::kDamping:
      return "damping field";
    case Rung::kZero:
      return "zero current";
  }
  return "invalid";
}

std::string sentence_for(Rung rung, HeldBack held_back) {
  std::string why;
  switch (held_back) {
    case HeldBack::kNot:
      return rung == Rung::kOld
                 ? "The newest sample is old; its force is rendered for a while longer."
                 : "Samples come; the force ramps in.";
    case HeldBack::kNoSamples:
      why = "no sample comes from the simulator";
      break;
    case HeldBack::kMotorCheck:
      why = "the motors are being checked";
      break;
    case HeldBack::kDeadMan:
      why = "the dead-man's switch is not held";
      break;
    case HeldBack::kPaused:
      why = "the force is paused";
      break;
  }
  return (rung == Rung::kDamping ? "The force gives way to a damping field: "
                                 : "Zero current, no force is rendered: ") +
         why + ".";
}

DegradationLadder::DegradationLadder(const LadderOptions& options) : options_(options) {
  if (!(options.ramp_in_s > 0.0) || !(options.fade_s > 0.0) || !(options.sample_timeout_s > 0.0) ||
      !(options.damping_s > 0.0)) {
    throw std::invalid_argument("ramp, fade, sample time-out and damping time must be positive");
  }
}

void DegradationLadder::update(double dt_s, double sample_age_s, double sample_period_s,
                               HeldBack held_back) noexcept {
  const bool known =
      sample_age_s <= std::max(options_.sample_timeout_s, kOldPeriods * sample_period_s);
  held_back_ = held_back == HeldBack::kNot && !known ? HeldBack::kNoSamples : held_back;
  const double faded = dt_s / options_.fade_s;
  if (held_back_ == HeldBack::kNot) {
    rung_ = sample_age_s <= kFreshPeriods * sample_period_s ? Rung::kFresh : Rung::kOld;
    force_gain_ = std::min(1.0, force_gain_ + dt_s / options_.ramp_in_s);
    damping_gain_ = std::max(0.0, damping_gain_ - faded);
    damping_left_s_ = options_.damping_s;
    return;
  }
  force_gain_ = std::max(0.0, force_gain_ - faded);
  damping_left_s_ = std::max(0.0, damping_left_s_ - dt_s);
  damping_gain_ = std::clamp(damping_gain_ + (damping_left_s_ > 0.0 ? faded : -faded), 0.0, 1.0);
  rung_ = force_gain_ > 0.0 || damping_gain_ > 0.0 ? Rung::kDamping : Rung::kZero;
}

void DegradationLadder::drop() noexcept {
  rung_ = Rung::kZero;
  force_gain_ = 0.0;
  damping_gain_ = 0.0;
  damping_left_s_ = 0.0;
}

}  // namespace forcegrid::servo
