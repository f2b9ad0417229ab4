// SPDX-License-Identifier: Apache-2.0
#include "view_link/surface_messages.h"

#include <algorithm>
#include <cmath>

#include "view_link/little_endian.h"

namespace forcegrid::view_link {
namespace {

constexpr float kSteps = 65535.0F;

bool all_finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(),
                     [](float value) { return std::isfinite(value); });
}

}  // namespace

Frame encode(const SurfaceShape& shape, std::uint16_t object) {
  Frame frame{static_cast<std::uint16_t>(SurfaceType::kShape), object, {}};
  append(frame.payload, shape.epoch);
  append(frame.payload, static_cast<std::uint32_t>(shape.rest_W_m.size()));
  append(frame.payload, static_cast<std::uint32_t>(shape.triangle.size()));
  append(frame.payload, std::uint32_t{0});
  append(frame.payload, std::span<const Point>(shape.rest_W_m));
  append(frame.payload, std::span<const Corners>(shape.triangle));
  return frame;
}

Frame encode(const SurfaceFrame& surface, std::uint16_t object) {
  Point low{}, step{};
  for (std::size_t axis = 0; axis < 3 && !surface.position_W_m.empty(); ++axis) {
    const auto less = [axis](const Point& a, const Point& b) { return a[axis] < b[axis]; };
    const auto [least, most] =
        std::minmax_element(surface.position_W_m.begin(), surface.position_W_m.end(), less);
    low[axis] = (*least)[axis];
    step[axis] = ((*most)[axis] - low[axis]) / kSteps;
  }
  Frame frame{static_cast<std::uint16_t>(SurfaceType::kFrame), object, {}};
  append(frame.payload, surface.epoch);
  append(frame.payload, static_cast<std::uint32_t>(surface.position_W_m.size()));
  append(frame.payload, std::uint32_t{0});
  append(frame.payload, surface.time_s);
  append(frame.payload, low);
  append(frame.payload, step);
  std::vector<std::uint16_t> rounded;
  rounded.reserve(3 * surface.position_W_m.size());
  for (const Point& position : surface.position_W_m) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float steps = step[axis] > 0.0F ? (position[axis] - low[axis]) / step[axis] : 0.0F;
      rounded.push_back(static_cast<std::uint16_t>(std::clamp(std::round(steps), 0.0F, kSteps)));
    }
  }
  append(frame.payload, std::span<const std::uint16_t>(rounded));
  return frame;
}

std::optional<SurfaceShape> decode_shape(std::span<const std::uint8_t> payload) {
  Reader reader(payload);
  SurfaceShape shape;
  shape.epoch = reader.take<std::uint32_t>();
  const auto vertices = reader.take<std::uint32_t>();
  const auto triangles = reader.take<std::uint32_t>();
  reader.take<std::uint32_t>();
  if (!reader.ok() || vertices > kMostVertices || triangles > kMostTriangles ||
      reader.left() != sizeof(Point) * vertices + sizeof(Corners) * triangles) {
    return std::nullopt;
  }
  shape.rest_W_m.resize(vertices);
  reader.take_into(std::span<Point>(shape.rest_W_m));
  shape.triangle.resize(triangles);
  reader.take_into(std::span<Corners>(shape.triangle));
  for (const Point& point : shape.rest_W_m) {
    if (!all_finite(point)) {
      return std::nullopt;
    }
  }
  for (const Corners& corners : shape.triangle) {
    if (*std::max_element(corners.begin(), corners.end()) >= vertices) {
      return std::nullopt;
    }
  }
  return shape;
}

std::optional<SurfaceFrame> decode_frame(std::span<const std::uint8_t> payload) {
  Reader reader(payload);
  SurfaceFrame frame;
  frame.epoch = reader.take<std::uint32_t>();
  const auto vertices = reader.take<std::uint32_t>();
  reader.take<std::uint32_t>();
  frame.time_s = reader.take<double>();
  const auto low = reader.take<Point>();
  const auto step = reader.take<Point>();
  if (!reader.ok() || vertices > kMostVertices ||
      reader.left() != 3 * sizeof(std::uint16_t) * vertices || !std::isfinite(frame.time_s) ||
      !all_finite(low) || !all_finite(step)) {
    return std::nullopt;
  }
  std::vector<std::array<std::uint16_t, 3>> rounded(vertices);
  reader.take_into(std::span<std::array<std::uint16_t, 3>>(rounded));
  frame.position_W_m.resize(vertices);
  for (std::size_t vertex = 0; vertex < vertices; ++vertex) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      frame.position_W_m[vertex][axis] =
          low[axis] + step[axis] * static_cast<float>(rounded[vertex][axis]);
    }
  }
  if (!std::all_of(frame.position_W_m.begin(), frame.position_W_m.end(),
                   [](const Point& point) { return all_finite(point); })) {
    return std::nullopt;
  }
  return frame;
}

}  // namespace forcegrid::view_link
