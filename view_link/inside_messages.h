// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "view_link/frame.h"
#include "view_link/surface_messages.h"

/// What is inside an object, as lines: the springs and the edges of the tetrahedra that it consists
/// of. A simulator sends it only while the live view wishes it (docs/view_protocol.md).
namespace forcegrid::view_link {

/// Types of the frames, beside those of SurfaceType.
enum class InsideType : std::uint16_t {
  kLines = 4,  ///< which edges there are
  kFrame = 5,  ///< where their vertices are
  kWish = 16,  ///< from the view to the simulator: whether somebody looks at the inside
};

inline constexpr std::uint32_t kMostEdges = 300'000;

using Edge = std::array<std::uint32_t, 2>;

/// The lines of an object. Their vertices are not numbered as those of its surface.
struct InsideLines {
  std::uint32_t epoch = 0;          ///< another one whenever vertices or edges change
  std::uint32_t vertices = 0;       ///< that a frame has; at most kMostVertices
  std::uint32_t springs = 0;        ///< of the object
  std::uint32_t element_edges = 0;  ///< edges of its tetrahedra
  std::vector<Edge> edge;  ///< all of them, springs first; none if there are more than kMostEdges
};

/// A frame of the stream. Real-time: no.
Frame encode(const InsideLines& lines, std::uint16_t object = 0);
/// Vertices of the lines, in the form of a surface's.
Frame encode_inside(const SurfaceFrame& vertices, std::uint16_t object = 0);
Frame encode_wish(bool inside);

/// Nothing for a payload that is truncated, too long, has too many vertices or edges, another
/// number of edges than it says, or an end that is no vertex. Real-time: no. Threads: any.
std::optional<InsideLines> decode_lines(std::span<const std::uint8_t> payload);
/// Whether the inside is wished; nothing for what is no wish. Bits that are not known are ignored.
std::optional<bool> decode_wish(std::span<const std::uint8_t> payload);

}  // namespace forcegrid::view_link
