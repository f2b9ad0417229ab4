// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rt/clock.h"
#include "simulator/drawn_mesh.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/touch/tool_contact.h"
#include "view_link/frame_sender.h"
#include "view_link/surface_messages.h"

namespace forcegrid::simulator {

/// Sends an object's surface, as it deforms, to the live view: its shape, and a frame whenever
/// a vertex has moved, at least one a second. A frame that the view has not taken when the next one
/// comes is dropped, so a slow view costs neither time nor memory. When the view goes away, one
/// line in the log says so, and the simulator goes on.
///
/// While the view wishes it, springs and elements inside the object are sent, too: the first show()
/// after the wish makes the list (2 ms for 85,000 springs), and each one copies all vertices.
///
/// Real-time: no (allocates, and takes FrameSender's lock for as long as a pointer is moved).
/// Threads: one, besides the sender's.
class SurfaceStream {
 public:
  /// Connects to the view's socket at `path`, and sends the shape and the surface at rest.
  /// `mesh` outlives this, or the next change().
  /// Throws view_link::ViewLinkError naming the path if nobody listens there, and Error for an
  /// object with more vertices or triangles than the view takes.
  SurfaceStream(const SpringMesh& mesh, const std::string& path);
  ~SurfaceStream();
  SurfaceStream(const SurfaceStream&) = delete;
  SurfaceStream& operator=(const SurfaceStream&) = delete;

  /// The object is another one from now on: it was cut, or is whole again. Sends its shape.
  /// Throws Error as the constructor does.
  void change(const SpringMesh& mesh);

  /// Tells that the object may have moved since the last show().
  void touch() noexcept { moved_ = true; }

  /// Copies where these vertices of the mesh are, [m] in W, to the vector, which gets their number.
  using CopyPositions =
      std::function<void(const std::vector<std::int32_t>&, std::vector<Eigen::Vector3d>&)>;

  /// Sends the surface if it has moved since the last frame, or if that was a second ago. Likewise
  /// the inside, if it is wished.
  void show(const CopyPositions& copy_positions);
  void show(ToolContact& contact);

  struct Counts {
    std::uint64_t frames = 0;         ///< of the surface, handed to the sender
    std::uint64_t inside_frames = 0;  ///< of the inside, likewise
    std::uint64_t dropped = 0;        ///< of both, because the view was slow
    bool lost = false;                ///< the view went away
  };
  Counts counts() const noexcept {
    return {frames_, inside_frames_, sender_->dropped(), sender_->lost()};
  }

  static constexpr rt::Duration kLongestSilence = std::chrono::seconds(1);
  /// [bytes/s] Of the inside: a frame of a large object waits until it may have gone at this rate.
  static constexpr double kMostInside_per_s = 3e6;

 private:
  void send_shape();
  void show_surface(const CopyPositions& copy_positions, rt::TimePoint now, bool moved);
  void show_inside(const CopyPositions& copy_positions, rt::TimePoint now, bool moved);
  void begin_inside();
  bool copy_points(const CopyPositions& copy_positions, const std::vector<std::int32_t>& vertices);
  void send(rt::TimePoint now);

  const SpringMesh* mesh_;
  DrawnSurface surface_;
  view_link::SurfaceFrame frame_;      ///< the newest that was sent
  std::optional<DrawnInside> inside_;  ///< nothing: it is not sent
  view_link::SurfaceFrame inside_frame_;
  std::vector<Eigen::Vector3d> position_W_;
  std::vector<view_link::Point> point_W_m_;
  rt::TimePoint sent_{};
  rt::TimePoint inside_sent_{};
  bool moved_ = false;
  bool inside_moved_ = false;
  std::uint64_t frames_ = 0;
  std::uint64_t inside_frames_ = 0;
  std::atomic<bool> inside_wished_{false};
  std::unique_ptr<view_link::FrameSender> sender_;
};

}  // namespace forcegrid::simulator
