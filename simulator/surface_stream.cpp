// SPDX-License-Identifier: Apache-2.0
#include "simulator/surface_stream.h"

#include <utility>

#include "log/log.h"
#include "simulator/mesh/error.h"
#include "view_link/inside_messages.h"

namespace forcegrid::simulator {
namespace {

using view_link::InsideType;

void check_size(std::size_t count, std::uint32_t most, const std::string& what) {
  if (count > most) {
    throw Error("simulator: --surface: the object's surface has " + std::to_string(count) + " " +
                what + "; the live view takes at most " + std::to_string(most));
  }
}

view_link::Point to_point(const Eigen::Vector3d& position_W) {
  const Eigen::Vector3f rounded_W = position_W.cast<float>();
  return {rounded_W.x(), rounded_W.y(), rounded_W.z()};
}

}  // namespace

SurfaceStream::SurfaceStream(const SpringMesh& mesh, const std::string& path) : mesh_(&mesh) {
  view_link::FrameSender::Options options;
  options.path = path;
  options.on_frame = [this](const view_link::Frame& frame) {
    if (frame.type == static_cast<std::uint16_t>(InsideType::kWish)) {
      inside_wished_.store(view_link::decode_wish(frame.payload).value_or(false));
    }
  };
  options.on_lost = [path](const std::string& why) {
    log::warn("simulator", "simulator: the live view at " + path + " has gone away (" + why +
                               "); the simulator goes on without it");
  };
  sender_ = std::make_unique<view_link::FrameSender>(std::move(options));
  send_shape();
}

void SurfaceStream::change(const SpringMesh& mesh) {
  mesh_ = &mesh;
  inside_.reset();
  send_shape();
}

void SurfaceStream::send_shape() {
  surface_ = drawn_surface(*mesh_);
  check_size(surface_.vertices.size(), view_link::kMostVertices, "vertices");
  check_size(surface_.triangles.size(), view_link::kMostTriangles, "triangles");
  view_link::SurfaceShape shape;
  shape.epoch = ++frame_.epoch;
  shape.triangle = surface_.triangles;
  shape.rest_W_m.reserve(surface_.vertices.size());
  for (const std::int32_t vertex : surface_.vertices) {
    shape.rest_W_m.push_back(to_point(mesh_->rest_position_W[static_cast<std::size_t>(vertex)]));
  }
  sender_->push(view_link::encode(shape));
  frame_.position_W_m = std::move(shape.rest_W_m);
  moved_ = true;
  send(rt::Clock::now());
}

SurfaceStream::~SurfaceStream() = default;

void SurfaceStream::show(ToolContact& contact) {
  show([&contact](const std::vector<std::int32_t>& vertices, std::vector<Eigen::Vector3d>& at_W) {
    contact.copy_positions(vertices, at_W);
  });
}

void SurfaceStream::show(const CopyPositions& copy_positions) {
  if (sender_->lost()) {
    return;
  }
  const rt::TimePoint now = rt::Clock::now();
  const bool moved = std::exchange(moved_, false);
  show_surface(copy_positions, now, moved);
  show_inside(copy_positions, now, moved);
}

// Where they are, into point_W_m_. False: the object is about to be reset.
bool SurfaceStream::copy_points(const CopyPositions& copy_positions,
                                const std::vector<std::int32_t>& vertices) {
  copy_positions(vertices, position_W_);
  point_W_m_.clear();
  for (const Eigen::Vector3d& position_W : position_W_) {
    if (!position_W.allFinite()) {
      return false;
    }
    point_W_m_.push_back(to_point(position_W));
  }
  return true;
}

void SurfaceStream::show_surface(const CopyPositions& copy_positions, rt::TimePoint now,
                                 bool moved) {
  const bool due = now - sent_ >= kLongestSilence;
  if ((!moved && !due) || !copy_points(copy_positions, surface_.vertices) ||
      (!due && point_W_m_ == frame_.position_W_m)) {
    return;
  }
  frame_.position_W_m.swap(point_W_m_);
  send(now);
}

void SurfaceStream::show_inside(const CopyPositions& copy_positions, rt::TimePoint now,
                                bool moved) {
  if (!inside_wished_.load()) {
    inside_.reset();
    return;
  }
  const bool begins = !inside_;
  if (begins) {
    begin_inside();
  }
  inside_moved_ = inside_moved_ || moved;
  const double bytes = static_cast<double>(sizeof(std::uint16_t) * 3 * inside_->vertices.size());
  const bool due = begins || now - inside_sent_ >= kLongestSilence;
  const bool may = rt::seconds(now - inside_sent_) * kMostInside_per_s >= bytes;
  if (inside_->vertices.empty() || !(due || (inside_moved_ && may))) {
    return;
  }
  inside_moved_ = false;
  if (!copy_points(copy_positions, inside_->vertices) ||
      (!due && point_W_m_ == inside_frame_.position_W_m)) {
    return;
  }
  inside_frame_.position_W_m.swap(point_W_m_);
  inside_frame_.time_s = rt::seconds(now.time_since_epoch());
  sender_->push_newest(view_link::encode_inside(inside_frame_));
  inside_sent_ = now;
  ++inside_frames_;
}

void SurfaceStream::begin_inside() {
  inside_ = drawn_inside(*mesh_);
  inside_->lines.epoch = ++inside_frame_.epoch;
  sender_->push(view_link::encode(inside_->lines));
  inside_->lines.edge = {};  // the view has them
}

void SurfaceStream::send(rt::TimePoint now) {
  frame_.time_s = rt::seconds(now.time_since_epoch());
  sender_->push_newest(view_link::encode(frame_));
  sent_ = now;
  ++frames_;
}

}  // namespace forcegrid::simulator
