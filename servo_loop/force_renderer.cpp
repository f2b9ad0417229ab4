// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/force_renderer.h"

#include <algorithm>

#include "rt/vectors.h"
#include "servo_loop/motion_guard.h"

namespace forcegrid::servo {
namespace {

PassivityOptions within_profile(PassivityOptions options, const profiles::DeviceProfile& profile) {
  options.max_damping_N_s_per_m =
      std::min(options.max_damping_N_s_per_m, profile.limits.max_damping_N_s_per_m);
  // Counts wait for the bus to collect them, and a force for the bus to take it.
  options.transport_delay_s = 1e-6 * profile.usb.frame_period_us;
  return options;
}

DampingFieldOptions within_profile(DampingFieldOptions options,
                                   const profiles::DeviceProfile& profile) {
  options.damping_N_s_per_m =
      std::min(options.damping_N_s_per_m, profile.limits.max_damping_N_s_per_m);
  options.max_force_N = std::min(options.max_force_N, 0.25 * profile.limits.max_force_N);
  options.velocity_time_constant_s = MotionGuard::kVelocityTimeConstant_s;
  return options;
}

}  // namespace

ForceRenderer::ForceRenderer(const profiles::DeviceProfile& profile,
                             const RenderingOptions& options)
    : ladder_(options.ladder),
      damping_field_(within_profile(options.damping_field, profile)),
      guard_(within_profile(options.passivity, profile)),
      angle_per_count_rad_(driver::angle_per_count_rad(profile).matrix().asDiagonal()),
      box_min_D_(rt::to_vector(profile.limits.workspace_min_m)),
      box_max_D_(rt::to_vector(profile.limits.workspace_max_m)) {
  if (options.coupling) {
    coupling_.emplace(*options.coupling);
  }
}

Eigen::Vector3d ForceRenderer::touching_W(const Eigen::Vector3d& position_W) const noexcept {
  return coupling_ ? coupling_->proxy_W(position_W) : position_W;
}

bool ForceRenderer::in_workspace(const driver::ArmPose& pose) const noexcept {
  return (pose.position_D.array() >= box_min_D_.array()).all() &&
         (pose.position_D.array() <= box_max_D_.array()).all();
}

Eigen::Vector3d ForceRenderer::force(const Cycle& cycle, const driver::ArmPose& pose) noexcept {
  ladder_.update(cycle.elapsed_s, cycle.sample_age_s, cycle.sample_period_s, cycle.held_back);
  account_for_contact(cycle);
  if (ladder_.held_back() == HeldBack::kNot && ladder_.force_gain() < 1.0) {
    guard_.grant(kRampPower_J_per_s * cycle.elapsed_s);
  }
  const Eigen::Vector3d resolution_W_m =
      (pose.jacobian_D * angle_per_count_rad_).cwiseAbs().rowwise().sum();
  guard_.set_resolution(resolution_W_m);
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();
  Eigen::Vector3d damping_W = Eigen::Vector3d::Zero();
  tool_force_W_.setZero();
  if (in_workspace(pose)) {
    force_W = ladder_.force_gain() * cycle.method_force_W;
    tool_force_W_ = ladder_.force_gain() * cycle.tool_force_W;
    damping_W = ladder_.damping_gain() * damping_field_.force_W(cycle.velocity_W, resolution_W_m);
  }
  if (coupling_) {
    coupling_->advance(cycle.elapsed_s, force_W);
  }
  force_W = guard_.apply(cycle.elapsed_s, cycle.position_W, force_W);
  cycles_damped_ += guard_.damping_N_s_per_m() > 0.0 ? 1 : 0;
  cycles_shortened_ += guard_.scale() < 1.0 ? 1 : 0;
  wanted_W_ = force_W + damping_W + tool_force_W_;
  return wanted_W_;
}

// The limits shorten the force and let it rise slowly; what is left is shared by its parts.
void ForceRenderer::set_rendered(const Eigen::Vector3d& force_W) noexcept {
  const double wanted_N2 = wanted_W_.squaredNorm();
  const double left =
      wanted_N2 > 0.0 ? std::clamp(force_W.dot(wanted_W_) / wanted_N2, 0.0, 1.0) : 0.0;
  tool_force_share_ = tool_force_W_.isZero(0.0) ? 0.0 : left * ladder_.force_gain();
  guard_.set_rendered(force_W - left * tool_force_W_);
}

// Elastic energy that the hand has put in stays its own through a fade; only the end of the contact
// ends the account.
void ForceRenderer::account_for_contact(const Cycle& cycle) noexcept {
  out_of_contact_s_ = cycle.in_contact ? 0.0 : out_of_contact_s_ + cycle.elapsed_s;
  if (out_of_contact_s_ >= kContactOver_s) {
    guard_.open_account();
  }
}

void ForceRenderer::drop() noexcept {
  ladder_.drop();
  wanted_W_.setZero();
  tool_force_W_.setZero();
  guard_.restart();
  if (coupling_) {
    coupling_->reset();
  }
}

void ForceRenderer::describe(CycleRecord& record) const noexcept {
  record.gain = ladder_.force_gain();
  record.damping_gain = ladder_.damping_gain();
  record.rung = ladder_.rung();
  record.held_back = ladder_.held_back();
  record.energy_to_hand_J = guard_.energy_to_hand_J();
  record.passivity_damping_N_s_per_m = guard_.damping_N_s_per_m();
  record.passivity_scale = guard_.scale();
}

}  // namespace forcegrid::servo
