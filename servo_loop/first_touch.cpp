// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/first_touch.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::servo {
namespace {

// One rod of the tool, turned about its upper end by `tilt_rad` in W's x-z plane.
contact::Capsule rod_of(const NearSurface& surface, double tilt_rad) noexcept {
  const double length_m = surface.tool_length_m;
  const Eigen::Vector3d upper_T(0.0, 0.0, surface.tool_radius_m + length_m);
  return {upper_T + length_m * Eigen::Vector3d(std::sin(tilt_rad), 0.0, -std::cos(tilt_rad)),
          upper_T, surface.tool_radius_m};
}

// How the tool lies to the patch: its nearest rod of those that are over the patch and not beside
// it.
std::optional<contact::NearPatch::Clearance> clearance_of(
    const NearSurface& surface, const Eigen::Vector3d& position_W) noexcept {
  const double tilt_rad = 0.5 * surface.tool_opening_rad;
  const auto look = [&](double at_rad) {
    auto found =
        surface.patch.clearance(rod_of(surface, at_rad), position_W, FirstTouch::kMargin_m);
    return found && found->at_rim ? std::nullopt : found;
  };
  const auto one = look(tilt_rad);
  if (tilt_rad == 0.0) {
    return one;
  }
  const auto other = look(-tilt_rad);
  return !one || (other && other->gap_m < one->gap_m) ? other : one;
}

static_assert(FirstTouch::kFade_s == FirstTouch::kHandOver_s);  // one weight for both

double weight_left(double since_s, double whole_s) noexcept {
  return std::clamp(1.0 - since_s / whole_s, 0.0, 1.0);
}

}  // namespace

std::optional<NearSurface> near_surface(const link::SurfacePatch& message) noexcept {
  if (message.vertex_count > link::SurfacePatch::kMaxVertices ||
      message.triangle_count > link::SurfacePatch::kMaxTriangles) {
    return std::nullopt;
  }
  std::array<contact::NearPatch::Vertex, contact::NearPatch::kMaxVertices> vertices_W{};
  static_assert(link::SurfacePatch::kMaxVertices <= contact::NearPatch::kMaxVertices);
  static_assert(link::SurfacePatch::kMaxTriangles <= contact::NearPatch::kMaxTriangles);
  for (std::size_t v = 0; v < message.vertex_count; ++v) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      vertices_W[v][axis] =
          message.position_W_m[axis] + static_cast<double>(message.vertices_W_m[v][axis]);
    }
  }
  NearSurface surface;
  if (!surface.patch.set({vertices_W.data(), message.vertex_count},
                         {message.triangles.data(), message.triangle_count})) {
    return std::nullopt;
  }
  surface.time_s = 1e-9 * static_cast<double>(message.echo_servo_time_ns);
  surface.epoch = message.contact_epoch;
  surface.tool_radius_m = static_cast<double>(message.tool_radius_m);
  surface.tool_length_m = static_cast<double>(message.tool_length_m);
  surface.tool_opening_rad = 0.01 * message.tool_opening_crad;
  surface.has_press_forces = message.has_press_forces;
  for (std::size_t k = 0; k < surface.press_forces_W_N.size(); ++k) {
    std::ranges::copy(message.press_forces_W_N[k], surface.press_forces_W_N[k].begin());
  }
  surface.has_stiffness = message.has_stiffness;
  const auto& [xx, yy, zz, xy, xz, yz] = message.stiffness_W_N_per_m;
  surface.stiffness_W_N_per_m = {xx, xy, xz, xy, yy, yz, xz, yz, zz};
  return surface;
}

void FirstTouch::take(const NearSurface& surface) noexcept {
  surface_ = surface;
  ++counts_.patches;
}

void FirstTouch::answer(double time_s, double computed_for_s, bool in_contact,
                        std::uint32_t epoch) noexcept {
  if (!in_contact) {
    air_epoch_ = epoch;
    if (state_ == State::kTouching && computed_for_s > touched_s_) {
      ++counts_.denied;
      fade(time_s);
    } else if (state_ == State::kContact || state_ == State::kHandingOver) {
      state_ = State::kAir;
      last_gap_m_.reset();
    }
    return;
  }
  switch (state_) {
    case State::kTouching: {
      const double wait_s = std::max(0.0, time_s - touched_s_);
      ++counts_.answered;
      counts_.wait_sum_s += wait_s;
      counts_.wait_max_s = std::max(counts_.wait_max_s, wait_s);
      // Without a predicted force there is nothing to hand over: the method's force comes at once.
      state_ = force_.known() ? State::kHandingOver : State::kContact;
      turned_s_ = time_s;
      break;
    }
    case State::kFading:  // it was given up too early: the weight goes on from where it is
      state_ = State::kHandingOver;
      break;
    case State::kAir:
      ++counts_.unseen;
      state_ = State::kContact;
      break;
    case State::kHandingOver:
    case State::kContact:
      break;
  }
}

Eigen::Vector3d FirstTouch::force_W(double time_s, const Eigen::Vector3d& position_W,
                                    const Eigen::Vector3d& method_force_W) noexcept {
  if (!position_W.allFinite()) {
    last_gap_m_.reset();
    return method_force_W;
  }
  if (state_ == State::kAir) {
    look(time_s, position_W);
  }
  if (state_ == State::kTouching) {
    if (force_.height_m(position_W) > kLeft_m) {
      ++counts_.left;
      forget();
    } else if (time_s - touched_s_ > kPatience_s) {
      ++counts_.denied;
      fade(time_s);
    }
  }
  double weight = state_ == State::kTouching ? 1.0 : 0.0;
  if (state_ == State::kFading) {
    weight = weight_left(time_s - turned_s_, kFade_s);
    if (weight == 0.0) {
      forget();
    }
    return method_force_W + weight * force_.at(position_W);
  }
  if (state_ == State::kHandingOver) {
    weight = weight_left(time_s - turned_s_, kHandOver_s);
    if (weight == 0.0) {
      state_ = State::kContact;
    }
  }
  return (1.0 - weight) * method_force_W + weight * force_.at(position_W);
}

void FirstTouch::look(double time_s, const Eigen::Vector3d& position_W) noexcept {
  const bool holds = time_s - surface_.time_s <= kStale_s && surface_.epoch == air_epoch_;
  const auto clearance = holds ? clearance_of(surface_, position_W) : std::nullopt;
  if (!clearance) {
    last_gap_m_.reset();
    return;
  }
  if (clearance->gap_m > 0.0) {
    last_gap_m_ = clearance->gap_m;
    last_position_W_ = position_W;
  } else if (last_gap_m_) {
    touch(time_s, position_W, clearance->gap_m, clearance->normal_W);
  }
}

void FirstTouch::touch(double time_s, const Eigen::Vector3d& position_W, double gap_m,
                       const Eigen::Vector3d& normal_W) noexcept {
  const double share = *last_gap_m_ / (*last_gap_m_ - gap_m);
  force_.begin(surface_, last_position_W_ + share * (position_W - last_position_W_), normal_W);
  touched_s_ = time_s;
  last_gap_m_.reset();
  state_ = State::kTouching;
  ++counts_.touches;
  counts_.felt += force_.known() ? 1 : 0;
}

void FirstTouch::fade(double time_s) noexcept {
  state_ = State::kFading;
  turned_s_ = time_s;
}

void FirstTouch::forget() noexcept {
  state_ = acting() ? State::kAir : state_;
  last_gap_m_.reset();
}

}  // namespace forcegrid::servo
