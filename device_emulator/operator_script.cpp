// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/operator_script.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "device_emulator/wrist.h"
#include "rt/vectors.h"

namespace forcegrid::emulator {

OperatorScript::OperatorScript(const Options& options, const Eigen::Vector3d& home_D)
    : options_(options),
      motion_(options.motion, options.amplitude_m, options.seed, options.path),
      wrist_motion_(options.wrist_motion, options.wrist_rest_rad, options.wrist_reach_rad,
                    options.path),
      follower_(options.reach_m_per_s),
      home_D_(home_D),
      target_D_(home_D),
      return_from_D_(home_D),
      gimbal_rad_(options.wrist_rest_rad),
      return_from_gimbal_rad_(options.wrist_rest_rad) {}

OperatorScript::Options OperatorScript::on_device(Options options,
                                                  const profiles::DeviceProfile& profile) {
  options.reach_low_D = rt::to_vector(profile.limits.workspace_min_m);
  options.reach_high_D = rt::to_vector(profile.limits.workspace_max_m);
  options.reach_m_per_s = 0.5 * profile.limits.max_speed_m_per_s;
  if (profiles::has_wrist(profile)) {
    const auto& gimbal = profile.gimbal;
    std::array<std::int32_t, 6> pose{};
    std::copy(profile.calibration.pose_counts.begin(), profile.calibration.pose_counts.end(),
              pose.begin());
    options.wrist_rest_rad = Wrist(gimbal).joint_angle_rad(pose);
    options.wrist_reach_rad =
        (rt::to_vector(gimbal.joint_max_rad) - options.wrist_rest_rad)
            .cwiseMin(options.wrist_rest_rad - rt::to_vector(gimbal.joint_min_rad));
  }
  return options;
}

OperatorScript::Action OperatorScript::update(rt::TimePoint now, const Senses& senses) noexcept {
  Action action;
  const Eigen::Vector3d contact_D =
      options_.contact_D - Eigen::Vector3d(0.0, 0.0, options_.contact_depth_m);
  const Eigen::Vector3d approach_D =
      options_.contact_D + Eigen::Vector3d(0.0, 0.0, options_.approach_height_m);
  const auto enter = [&](Phase phase) {
    phase_ = phase;
    phase_start_ = now;
  };

  if (!senses.host_present) {
    host_since_.reset();
    loads_before_host_ = senses.counters_loaded;
    const bool at_home = phase_ == Phase::kCalibrating && !options_.homing;
    if (at_home) {
      enter(Phase::kWaiting);
    } else if (phase_ == Phase::kCalibrating || phase_ == Phase::kApproaching ||
               phase_ == Phase::kMoving) {
      return_from_D_ = target_D_;
      return_from_gimbal_rad_ = gimbal_rad_;
      enter(Phase::kReturning);
    }
  } else if (!host_since_) {
    host_since_ = now;
  }

  const bool calibrated =
      options_.calibrated || senses.homed || senses.counters_loaded != loads_before_host_;
  if (phase_ == Phase::kReturning && rt::seconds(now - phase_start_) >= kReturn_s) {
    enter(Phase::kWaiting);
  }
  if (phase_ == Phase::kWaiting && host_since_ &&
      rt::seconds(now - *host_since_) >= kButtonDelay_s) {
    if (calibrated && !options_.lets_go) {
      enter(Phase::kApproaching);
    } else if (!calibrated) {
      action.press_button = !options_.homing;
      enter(Phase::kCalibrating);
    }
  }
  if (phase_ == Phase::kCalibrating && calibrated) {
    return_from_D_ = target_D_;
    return_from_gimbal_rad_ = gimbal_rad_;
    enter(options_.homing || options_.lets_go ? Phase::kReturning : Phase::kApproaching);
  }
  if (options_.lets_go && calibrated && host_since_ && !has_let_go_) {
    calibrated_since_ = calibrated_since_.value_or(now);
    action.let_go = has_let_go_ = rt::seconds(now - *calibrated_since_) >= kLetGo_s;
  }

  const double since_s = rt::seconds(now - phase_start_);
  switch (phase_) {
    case Phase::kWaiting:
      target_D_ = home_D_;
      break;
    case Phase::kCalibrating:
      target_D_ = options_.homing ? homing_target_D(since_s) : home_D_;
      break;
    case Phase::kApproaching:
      target_D_ = home_D_ + minimum_jerk(since_s / kApproach_s) * (approach_D - home_D_) +
                  minimum_jerk((since_s - kApproach_s) / kDescent_s) * (contact_D - approach_D);
      if (since_s >= kApproach_s + kDescent_s + kPause_s) {
        enter(Phase::kMoving);
      }
      break;
    case Phase::kMoving:
      target_D_ = contact_D + motion_.displacement_D(since_s);
      break;
    case Phase::kReturning:
      target_D_ = return_from_D_ + minimum_jerk(since_s / kReturn_s) * (home_D_ - return_from_D_);
      break;
  }
  std::optional<Eigen::Vector3d> pointer_D;
  if (senses.pointer_D && (phase_ == Phase::kApproaching || phase_ == Phase::kMoving)) {
    pointer_D = senses.pointer_D->cwiseMax(options_.reach_low_D).cwiseMin(options_.reach_high_D);
  }
  action.target_D = follower_.update(now, target_D_, pointer_D);
  const double in_phase_s = rt::seconds(now - phase_start_);  // which may have begun just now
  gimbal_rad_ = gimbal_target_rad(in_phase_s);
  action.gimbal_rad = gimbal_rad_;
  action.stylus_pressed = phase_ == Phase::kMoving && options_.click_every_s > 0.0 &&
                          in_phase_s >= options_.click_every_s &&
                          std::fmod(in_phase_s, options_.click_every_s) < kClick_s;
  return action;
}

Eigen::Vector3d OperatorScript::gimbal_target_rad(double since_s) const noexcept {
  const Eigen::Vector3d& rest_rad = options_.wrist_rest_rad;
  switch (phase_) {
    case Phase::kApproaching:
      return rest_rad +
             minimum_jerk(since_s / kApproach_s) * (wrist_motion_.angle_rad(0.0) - rest_rad);
    case Phase::kMoving:
      return wrist_motion_.angle_rad(since_s);
    case Phase::kReturning:
      return return_from_gimbal_rad_ +
             minimum_jerk(since_s / kReturn_s) * (rest_rad - return_from_gimbal_rad_);
    case Phase::kWaiting:
    case Phase::kCalibrating:
      break;
  }
  return rest_rad;
}

Eigen::Vector3d OperatorScript::homing_target_D(double since_s) const noexcept {
  constexpr double kStrokeAndPause_s = kHomingStroke_s + kHomingPause_s;
  const double stroke = std::floor(since_s / kStrokeAndPause_s);
  const double fraction = minimum_jerk((since_s - stroke * kStrokeAndPause_s) / kHomingStroke_s);
  const bool outward = std::fmod(stroke, 2.0) == 0.0;
  const Eigen::Vector3d& to_D = outward ? options_.homing->out_D : options_.homing->in_D;
  const Eigen::Vector3d& from_D =
      stroke == 0.0 ? home_D_ : (outward ? options_.homing->in_D : options_.homing->out_D);
  return from_D + fraction * (to_D - from_D);
}

}  // namespace forcegrid::emulator
