#include "servo_loop/first_touch.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::servo {
namespace {

contact::Capsule tool_of(const NearSurface& surface) noexcept {
  const Eigen::Vector3d from_T(0.0, 0.0, surface.tool_radius_m);
  return {from_T, from_T + Eigen::Vector3d(0.0, 0.0, surface.tool_length_m), surface.tool_radius_m};
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
      state_ = State::kHandingOver;
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
    if (normal_W_.dot(position_W - point_W_) > kLeft_m) {
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
    return method_force_W + weight * model_force_W(position_W);
  }
  if (state_ == State::kHandingOver) {
    weight = weight_left(time_s - turned_s_, kHandOver_s);
    if (weight == 0.0) {
      state_ = State::kContact;
    }
  }
  return (1.0 - weight) * method_force_W + weight * model_force_W(position_W);
}

void FirstTouch::look(double time_s, const Eigen::Vector3d& position_W) noexcept {
  const bool holds = time_s - surface_.time_s <= kStale_s && surface_.epoch == air_epoch_;
  const auto clearance =
      holds ? surface_.patch.clearance(tool_of(surface_), position_W, kMargin_m) : std::nullopt;
  if (!clearance || clearance->at_rim) {
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
  point_W_ = last_position_W_ + share * (position_W - last_position_W_);
  normal_W_ = normal_W;
  stiffness_W_N_per_m_.setZero();
  if (surface_.has_stiffness) {
    stiffness_W_N_per_m_ = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
        surface_.stiffness_W_N_per_m.data());
  }
  touched_s_ = time_s;
  last_gap_m_.reset();
  state_ = State::kTouching;
  ++counts_.touches;
}

Eigen::Vector3d FirstTouch::model_force_W(const Eigen::Vector3d& position_W) const noexcept {
  const Eigen::Vector3d whole_W = stiffness_W_N_per_m_ * (position_W - point_W_);
  const double push_N = normal_W_.dot(whole_W);
  if (!(push_N > 0.0)) {
    return Eigen::Vector3d::Zero();
  }
  Eigen::Vector3d along_W = whole_W - push_N * normal_W_;
  const double along_N = along_W.norm();
  if (along_N > push_N) {
    along_W *= push_N / along_N;
  }
  const Eigen::Vector3d force_W = push_N * normal_W_ + along_W;
  const double force_N = force_W.norm();
  return force_N > max_force_N_ ? Eigen::Vector3d(max_force_N_ / force_N * force_W) : force_W;
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
