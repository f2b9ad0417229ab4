// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "view_link/frame.h"

namespace forcegrid::view_link {

/// Types of the frames of a simulator's surface stream.
enum class SurfaceType : std::uint16_t {
  kShape = 2,  ///< which vertices there are, and which triangles they make
  kFrame = 3,  ///< where the vertices are
};

inline constexpr std::uint32_t kMostVertices = 1'000'000;
inline constexpr std::uint32_t kMostTriangles = 2'000'000;

using Point = std::array<float, 3>;
using Corners = std::array<std::uint32_t, 3>;

/// The surface of an object at rest, in the workspace frame W.
struct SurfaceShape {
  std::uint32_t epoch = 0;        ///< another one whenever vertices or triangles change
  std::vector<Point> rest_W_m;    ///< at rest
  std::vector<Corners> triangle;  ///< counter-clockwise seen from outside
};

/// The surface at one instant. Vertices are rounded to 1/65535 of their box, which is 2 um for a
/// box of 13 cm.
struct SurfaceFrame {
  std::uint32_t epoch = 0;  ///< of the shape that it belongs to
  double time_s = 0.0;      ///< of the simulator's clock
  std::vector<Point> position_W_m;
};

/// A frame of the stream. Real-time: no.
Frame encode(const SurfaceShape& shape, std::uint16_t object = 0);
Frame encode(const SurfaceFrame& surface, std::uint16_t object = 0);

/// Nothing for a payload that is truncated, too long, has too many vertices or triangles, a number
/// that is not finite, or a corner that is no vertex. Real-time: no. Threads: any.
std::optional<SurfaceShape> decode_shape(std::span<const std::uint8_t> payload);
std::optional<SurfaceFrame> decode_frame(std::span<const std::uint8_t> payload);

}  // namespace forcegrid::view_link
