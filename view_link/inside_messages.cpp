// SPDX-License-Identifier: Apache-2.0
#include "view_link/inside_messages.h"

#include <algorithm>

#include "view_link/little_endian.h"

namespace forcegrid::view_link {
namespace {

constexpr std::uint32_t kInsideBit = 1;

}  // namespace

Frame encode(const InsideLines& lines, std::uint16_t object) {
  Frame frame{static_cast<std::uint16_t>(InsideType::kLines), object, {}};
  append(frame.payload, lines.epoch);
  append(frame.payload, lines.vertices);
  append(frame.payload, lines.springs);
  append(frame.payload, lines.element_edges);
  append(frame.payload, static_cast<std::uint32_t>(lines.edge.size()));
  append(frame.payload, std::span<const Edge>(lines.edge));
  return frame;
}

Frame encode_inside(const SurfaceFrame& vertices, std::uint16_t object) {
  Frame frame = encode(vertices, object);
  frame.type = static_cast<std::uint16_t>(InsideType::kFrame);
  return frame;
}

Frame encode_wish(bool inside) {
  Frame frame{static_cast<std::uint16_t>(InsideType::kWish), 0, {}};
  append(frame.payload, inside ? kInsideBit : std::uint32_t{0});
  return frame;
}

std::optional<InsideLines> decode_lines(std::span<const std::uint8_t> payload) {
  Reader reader(payload);
  InsideLines lines;
  lines.epoch = reader.take<std::uint32_t>();
  lines.vertices = reader.take<std::uint32_t>();
  lines.springs = reader.take<std::uint32_t>();
  lines.element_edges = reader.take<std::uint32_t>();
  const auto edges = reader.take<std::uint32_t>();
  const std::uint64_t all = std::uint64_t{lines.springs} + lines.element_edges;
  if (!reader.ok() || lines.vertices > kMostVertices || edges != (all > kMostEdges ? 0 : all) ||
      reader.left() != sizeof(Edge) * edges) {
    return std::nullopt;
  }
  lines.edge.resize(edges);
  reader.take_into(std::span<Edge>(lines.edge));
  for (const Edge& edge : lines.edge) {
    if (std::max(edge[0], edge[1]) >= lines.vertices) {
      return std::nullopt;
    }
  }
  return lines;
}

std::optional<bool> decode_wish(std::span<const std::uint8_t> payload) {
  Reader reader(payload);
  const auto bits = reader.take<std::uint32_t>();
  if (!reader.ok() || reader.left() != 0) {
    return std::nullopt;
  }
  return (bits & kInsideBit) != 0;
}

}  // namespace forcegrid::view_link
