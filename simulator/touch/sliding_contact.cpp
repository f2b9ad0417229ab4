// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/sliding_contact.h"

namespace forcegrid::simulator {
namespace {

constexpr double kTouching_m = 1e-6;  // close enough to be a touch
constexpr int kMaxLooks = 64;

}  // namespace

SlidingContact::SlidingContact(const SpringMesh& mesh, const contact::ToolShape& tool,
                               const SlidingOptions& options)
    : object_(mesh, tool, options.press), options_(options), surface_(mesh) {}

bool SlidingContact::overlaps(const Eigen::Vector3d& position_W) const noexcept {
  return surface_.look(position_W).inside || object_.gap_m(position_W, 0.0) < 0.0;
}

// Sphere tracing: each step is as long as the gap, so it never crosses the surface.
std::optional<Eigen::Vector3d> SlidingContact::touch_along(
    const Eigen::Vector3d& from_W, const Eigen::Vector3d& path_W) const noexcept {
  const double length_m = path_W.norm();
  double gone_m = 0.0;
  for (int trace = 0; trace < kMaxLooks; ++trace) {
    const Eigen::Vector3d here_W =
        length_m > 0.0 ? Eigen::Vector3d(from_W + gone_m / length_m * path_W) : from_W;
    const double gap_m = object_.gap_m(here_W, length_m - gone_m + kTouching_m);
    if (gap_m <= kTouching_m) {
      return here_W;
    }
    gone_m += gap_m;
    if (gone_m >= length_m) {
      return std::nullopt;
    }
  }
  return std::nullopt;
}

std::optional<Eigen::Vector3d> SlidingContact::expected_touch(const Eigen::Vector3d& position_W,
                                                              const Eigen::Vector3d& velocity_W,
                                                              double within_s) const noexcept {
  if (in_contact_ || must_leave_first_ || !position_W.allFinite() || !velocity_W.allFinite() ||
      velocity_W.isZero(0.0)) {
    return std::nullopt;
  }
  return touch_along(position_W, within_s * velocity_W);
}

void SlidingContact::turn_to(const Eigen::Quaterniond& orientation_WT) noexcept {
  if (options_.turns && orientation_WT.coeffs().allFinite()) {
    orientation_WT_ = orientation_WT.normalized();
  }
}

ToolContact::Answer SlidingContact::step(const Eigen::Vector3d& position_W) {
  if (!position_W.allFinite()) {
    pressed_.equilibrium.converged = false;
    pressed_.equilibrium.reached = false;
  } else {
    if (!last_position_W_) {
      object_.reset(position_W, orientation_WT_);
      must_leave_first_ = overlaps(position_W);
    }
    if (must_leave_first_) {
      object_.reset(position_W, orientation_WT_);
      must_leave_first_ = overlaps(position_W);
      pressed_ = Pressed{};
      pressed_.equilibrium.converged = true;
      pressed_.position_W = position_W;
    } else {
      press(position_W);
    }
    last_position_W_ = position_W;
  }
  Answer answer;
  answer.in_contact = in_contact_;
  answer.epoch = epoch_;
  answer.position_W = pressed_.position_W;
  answer.point_W = in_contact_ ? point_W_ : pressed_.position_W;
  answer.orientation_WT = pressed_.orientation_WT;
  answer.equilibrium = pressed_.equilibrium;
  answer.equilibrium.torque_known = options_.turns;
  answer.stiffness_known = pressed_.stiffness_known;
  return answer;
}

void SlidingContact::press(const Eigen::Vector3d& position_W) {
  const Eigen::Vector3d from_W = last_position_W_.value_or(position_W);
  // Before the surface moves.
  const auto touch_W = in_contact_ ? std::nullopt : touch_along(from_W, position_W - from_W);
  pressed_ = object_.move_to(position_W, orientation_WT_);
  if (holding_ && pressed_.held == 0) {
    holding_ = false;  // the object has snapped out of the jaws
  }
  const bool touching = pressed_.points > 0;
  if (touching != in_contact_ || pressed_.equilibrium.left_branch) {
    ++epoch_;
  }
  if (touching && !in_contact_) {
    point_W_ = touch_W.value_or(position_W);
  }
  in_contact_ = touching;
  work_jaws();
}

void SlidingContact::work_jaws() noexcept {
  if (object_.tool().kind() != contact::ToolShape::Kind::kGrasper) {
    return;
  }
  if (!in_contact_) {
    has_let_go_ = false;
    return;
  }
  const double along_N = pressed_.equilibrium.force_W.dot(object_.tool().rotation_WT().col(2));
  if (!holding_ && !has_let_go_ && along_N >= options_.grasp_N) {
    holding_ = object_.grasp() > 0;
    epoch_ += holding_ ? 1 : 0;
  } else if (holding_ && along_N <= -options_.let_go_N) {
    object_.let_go();
    holding_ = false;
    has_let_go_ = true;
    ++epoch_;
  }
}

void SlidingContact::reset() noexcept {
  object_.let_go();
  orientation_WT_ = Eigen::Quaterniond::Identity();
  object_.reset(Eigen::Vector3d::Zero(), orientation_WT_);
  pressed_ = Pressed{};
  last_position_W_.reset();
  point_W_.setZero();
  epoch_ = 0;
  in_contact_ = must_leave_first_ = holding_ = has_let_go_ = false;
}

}  // namespace forcegrid::simulator
