#include "device_emulator/operator_script.h"

namespace forcegrid::emulator {

OperatorScript::OperatorScript(const Options& options, const Eigen::Vector3d& home_D)
    : options_(options),
      motion_(options.motion, options.amplitude_m, options.seed),
      home_D_(home_D),
      target_D_(home_D),
      return_from_D_(home_D) {}

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
    if (phase_ == Phase::kCalibrating) {
      enter(Phase::kWaiting);
    } else if (phase_ == Phase::kApproaching || phase_ == Phase::kMoving) {
      return_from_D_ = target_D_;
      enter(Phase::kReturning);
    }
  } else if (!host_since_) {
    host_since_ = now;
  }

  if (phase_ == Phase::kReturning && rt::seconds(now - phase_start_) >= kReturn_s) {
    enter(Phase::kWaiting);
  }
  if (phase_ == Phase::kWaiting && host_since_ &&
      rt::seconds(now - *host_since_) >= kButtonDelay_s) {
    if (options_.calibrated || senses.counters_loaded != loads_before_host_) {
      enter(Phase::kApproaching);
    } else {
      action.press_button = true;
      enter(Phase::kCalibrating);
    }
  }
  if (phase_ == Phase::kCalibrating && senses.counters_loaded != loads_before_host_) {
    enter(Phase::kApproaching);
  }

  const double since_s = rt::seconds(now - phase_start_);
  switch (phase_) {
    case Phase::kWaiting:
    case Phase::kCalibrating:
      target_D_ = home_D_;
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
  action.target_D = target_D_;
  return action;
}

}  // namespace forcegrid::emulator
