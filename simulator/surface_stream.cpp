// SPDX-License-Identifier: Apache-2.0
#include "simulator/surface_stream.h"

#include <utility>

#include "log/log.h"
#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

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

DrawnSurface drawn_surface(const SpringMesh& mesh) {
  DrawnSurface surface;
  std::vector<bool> is_corner(mesh.rest_position_W.size(), false);
  for (const auto& triangle : mesh.triangles) {
    for (const std::int32_t vertex : triangle) {
      is_corner[static_cast<std::size_t>(vertex)] = true;
    }
  }
  std::vector<std::uint32_t> number(is_corner.size(), 0);
  for (std::size_t vertex = 0; vertex < is_corner.size(); ++vertex) {
    if (is_corner[vertex]) {
      number[vertex] = static_cast<std::uint32_t>(surface.vertices.size());
      surface.vertices.push_back(static_cast<std::int32_t>(vertex));
    }
  }
  surface.triangles.reserve(mesh.triangles.size());
  for (const auto& [a, b, c] : mesh.triangles) {
    surface.triangles.push_back({number[static_cast<std::size_t>(a)],
                                 number[static_cast<std::size_t>(b)],
                                 number[static_cast<std::size_t>(c)]});
  }
  return surface;
}

SurfaceStream::SurfaceStream(const SpringMesh& mesh, const std::string& path) {
  view_link::FrameSender::Options options;
  options.path = path;
  options.on_lost = [path](const std::string& why) {
    log::warn("simulator", "simulator: the live view at " + path + " has gone away (" + why +
                               "); the simulator goes on without it");
  };
  sender_ = std::make_unique<view_link::FrameSender>(std::move(options));
  change(mesh);
}

void SurfaceStream::change(const SpringMesh& mesh) {
  surface_ = drawn_surface(mesh);
  check_size(surface_.vertices.size(), view_link::kMostVertices, "vertices");
  check_size(surface_.triangles.size(), view_link::kMostTriangles, "triangles");
  view_link::SurfaceShape shape;
  shape.epoch = ++frame_.epoch;
  shape.triangle = surface_.triangles;
  shape.rest_W_m.reserve(surface_.vertices.size());
  for (const std::int32_t vertex : surface_.vertices) {
    shape.rest_W_m.push_back(to_point(mesh.rest_position_W[static_cast<std::size_t>(vertex)]));
  }
  sender_->push(view_link::encode(shape));
  frame_.position_W_m = std::move(shape.rest_W_m);
  moved_ = true;
  send(rt::Clock::now());
}

SurfaceStream::~SurfaceStream() = default;

void SurfaceStream::show(ToolContact& contact) {
  const rt::TimePoint now = rt::Clock::now();
  const bool due = now - sent_ >= kLongestSilence;
  if ((!moved_ && !due) || sender_->lost()) {
    return;
  }
  moved_ = false;
  contact.copy_positions(surface_.vertices, position_W_);
  point_W_m_.clear();
  for (const Eigen::Vector3d& position_W : position_W_) {
    if (!position_W.allFinite()) {
      return;  // the object is about to be reset
    }
    point_W_m_.push_back(to_point(position_W));
  }
  if (!due && point_W_m_ == frame_.position_W_m) {
    return;
  }
  frame_.position_W_m.swap(point_W_m_);
  send(now);
}

void SurfaceStream::send(rt::TimePoint now) {
  frame_.time_s = rt::seconds(now.time_since_epoch());
  sender_->push_newest(view_link::encode(frame_));
  sent_ = now;
  ++frames_;
}

}  // namespace forcegrid::simulator
