// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/touch/sticky_contact.h"

// The templates of StickyContact. Only the source that instantiates them for an object includes
// this, with FORCEGRID_INSTANTIATE_STICKY_CONTACT(Object) in namespace forcegrid::simulator.
namespace forcegrid::simulator {

template <typename Object>
Equilibrium StickyContact::move(Object& object, const Eigen::Vector3d& position_W) const {
  if constexpr (requires { object.turns(); }) {
    if (object.turns()) {
      return object.move_to(position_W - point_W_, orientation_WT_ * touched_WT_.conjugate());
    }
  }
  return object.move_to(position_W - point_W_);
}

template <typename Object>
StickyContact::Answer StickyContact::step(Object& object, const Eigen::Vector3d& position_W) {
  Answer answer;
  if (!position_W.allFinite()) {
    answer.in_contact = in_contact_;
    answer.epoch = epoch_;
    answer.point_W = in_contact_ || !last_position_W_ ? point_W_ : *last_position_W_;
    answer.equilibrium = object.move_to(position_W);
    answer.equilibrium.converged = false;
    answer.equilibrium.reached = false;
    if (!in_contact_) {
      answer.equilibrium.displacement_W.setZero();
    }
    answer.position_W = answer.point_W + answer.equilibrium.displacement_W;
    answer.orientation_WT = turned_WT(answer.equilibrium.turn_W);
    return answer;
  }
  if (!in_contact_) {
    const bool touching = at_surface(position_W);
    if (!last_position_W_ && touching) {
      must_leave_first_ = true;
    }
    if (!touching) {
      must_leave_first_ = false;
    } else if (!must_leave_first_ && object.grab(position_W, options_.patch_radius_m) > 0) {
      in_contact_ = true;
      point_W_ = position_W;
      touched_WT_ = orientation_WT_;
      ++epoch_;
    }
  }
  last_position_W_ = position_W;
  answer.in_contact = in_contact_;
  answer.point_W = in_contact_ ? point_W_ : position_W;
  answer.position_W = position_W;
  if (in_contact_) {
    answer.equilibrium = move(object, position_W);
    if (answer.equilibrium.left_branch) {
      ++epoch_;
    }
    if (!answer.equilibrium.reached) {
      answer.position_W = point_W_ + answer.equilibrium.displacement_W;
    }
  } else {
    answer.equilibrium.converged = true;
  }
  answer.epoch = epoch_;
  answer.orientation_WT = in_contact_ ? turned_WT(answer.equilibrium.turn_W) : orientation_WT_;
  return answer;
}

template <typename Object>
void StickyContact::release(Object& object) noexcept {
  if (in_contact_) {
    object.release();
    in_contact_ = false;
    must_leave_first_ = true;
    ++epoch_;
  }
}

template <typename Object>
void StickyContact::reset(Object& object) noexcept {
  object.release();
  in_contact_ = false;
  must_leave_first_ = false;
  last_position_W_.reset();
  point_W_.setZero();
  orientation_WT_ = touched_WT_ = Eigen::Quaterniond::Identity();
  if (options_.tool) {
    options_.tool->set_orientation(orientation_WT_);
  }
  epoch_ = 0;
}

}  // namespace forcegrid::simulator

// NOLINTBEGIN(bugprone-macro-parentheses): a type cannot be in parentheses.
#define FORCEGRID_INSTANTIATE_STICKY_CONTACT(Object)                                   \
  template StickyContact::Answer StickyContact::step(Object&, const Eigen::Vector3d&); \
  template void StickyContact::release(Object&) noexcept;                              \
  template void StickyContact::reset(Object&) noexcept
// NOLINTEND(bugprone-macro-parentheses)
