// SPDX-License-Identifier: Apache-2.0
#include "device_session/commanded_force.h"

#include <algorithm>

namespace forcegrid::session {

void CommandedForce::command(const Eigen::Vector3d& force_W, const Eigen::Vector3d& torque_W_Nm,
                             rt::TimePoint now, rt::Duration hold) noexcept {
  commands_.publish({.force_W_N = {force_W.x(), force_W.y(), force_W.z()},
                     .torque_W_Nm = {torque_W_Nm.x(), torque_W_Nm.y(), torque_W_Nm.z()},
                     .time_s = rt::seconds(now.time_since_epoch()),
                     .hold_s = rt::seconds(hold)});
}

bool CommandedForce::callback_lasts_too_long(double time_s) const noexcept {
  const std::int64_t busy_since_ns = busy_since_ns_.load();
  return busy_since_ns != 0 &&
         time_s - rt::seconds(rt::Duration(busy_since_ns)) > rt::seconds(longest_callback_);
}

void CommandedForce::observe(double time_s, const Eigen::Vector3d& /*position_W*/) noexcept {
  static_cast<void>(commands_.fetch(newest_));
  if (callback_lasts_too_long(time_s)) {
    newest_ = {};  // until the program commands again
  }
}

ForceEstimate CommandedForce::force(double time_s,
                                    const Eigen::Vector3d& /*position_W*/) const noexcept {
  ForceEstimate estimate;
  estimate.force_W = share_at(time_s) * Eigen::Vector3d(newest_.force_W_N);
  estimate.status = EstimateStatus::kOk;
  estimate.uncertainty_N = 0.0;
  return estimate;
}

double CommandedForce::share_at(double time_s) const noexcept {
  const double over_s = time_s - newest_.time_s - newest_.hold_s;
  return std::clamp(1.0 - over_s / kFade_s, 0.0, 1.0);
}

Eigen::Vector3d CommandedForce::torque_W_Nm(double time_s) const noexcept {
  return share_at(time_s) * Eigen::Vector3d(newest_.torque_W_Nm);
}

}  // namespace forcegrid::session
