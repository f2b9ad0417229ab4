// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rt/clock.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/touch/tool_contact.h"
#include "view_link/frame_sender.h"
#include "view_link/surface_messages.h"

namespace forcegrid::simulator {

/// The part of a mesh that the live view draws: the vertices that a triangle has, renumbered.
struct DrawnSurface {
  std::vector<std::int32_t> vertices;                   ///< the mesh's number of each, ascending
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< of SpringMesh::triangles, same order
};
DrawnSurface drawn_surface(const SpringMesh& mesh);

/// Sends an object's surface, as it deforms, to the live view: its shape, and a frame whenever
/// a vertex has moved, at least one a second. A frame that the view has not taken when the next one
/// comes is dropped, so a slow view costs neither time nor memory. When the view goes away, one
/// line in the log says so, and the simulator goes on.
///
/// Real-time: no (allocates, and takes FrameSender's lock for as long as a pointer is moved).
/// Threads: one, besides the sender's.
class SurfaceStream {
 public:
  /// Connects to the view's socket at `path`, and sends the shape and the surface at rest.
  /// Throws view_link::ViewLinkError naming the path if nobody listens there, and Error for an
  /// object with more vertices or triangles than the view takes.
  SurfaceStream(const SpringMesh& mesh, const std::string& path);
  ~SurfaceStream();
  SurfaceStream(const SurfaceStream&) = delete;
  SurfaceStream& operator=(const SurfaceStream&) = delete;

  /// The object has another surface from now on: it was cut, or is whole again. Sends its shape.
  /// Throws Error as the constructor does.
  void change(const SpringMesh& mesh);

  /// Tells that the object may have moved since the last show().
  void touch() noexcept { moved_ = true; }

  /// Sends the surface if it has moved since the last frame, or if that was a second ago.
  void show(ToolContact& contact);

  struct Counts {
    std::uint64_t frames = 0;   ///< handed to the sender
    std::uint64_t dropped = 0;  ///< of them, because the view was slow
    bool lost = false;          ///< the view went away
  };
  Counts counts() const noexcept { return {frames_, sender_->dropped(), sender_->lost()}; }

  static constexpr rt::Duration kLongestSilence = std::chrono::seconds(1);

 private:
  void send(rt::TimePoint now);

  DrawnSurface surface_;
  view_link::SurfaceFrame frame_;  ///< the newest that was sent
  std::vector<Eigen::Vector3d> position_W_;
  std::vector<view_link::Point> point_W_m_;
  rt::TimePoint sent_{};
  bool moved_ = false;
  std::uint64_t frames_ = 0;
  std::unique_ptr<view_link::FrameSender> sender_;
};

}  // namespace forcegrid::simulator
