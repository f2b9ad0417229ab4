// SPDX-License-Identifier: Apache-2.0
#include "tools/surface_recorder.h"

#include <algorithm>

namespace forcegrid::tools {
namespace {

constexpr std::uint64_t kRows = 64;            // of a chunk of the tables
constexpr std::uint64_t kVertexRows = 16'384;  // of a chunk of vertices

template <typename Number>
std::vector<double> flat(const std::vector<std::array<Number, 3>>& rows) {
  std::vector<double> numbers;
  numbers.reserve(3 * rows.size());
  for (const auto& row : rows) {
    numbers.insert(numbers.end(), row.begin(), row.end());
  }
  return numbers;
}

std::vector<double> flat(const std::array<float, 3>& row) { return {row.begin(), row.end()}; }

}  // namespace

bool SurfaceBound::take(double time_s, std::size_t bytes) noexcept {
  room_bytes_ = std::min(kMost_bytes_per_s,
                         room_bytes_ + kMost_bytes_per_s * std::max(0.0, time_s - last_s_));
  last_s_ = std::max(last_s_, time_s);
  // A frame that no second has room for may use all of one, and a debt that later ones wait for.
  const bool fits = room_bytes_ > 0.0 && taken_bytes_ + static_cast<double>(bytes) <= kMost_bytes;
  if (fits) {
    room_bytes_ -= static_cast<double>(bytes);
    taken_bytes_ += static_cast<double>(bytes);
  }
  return fits;
}

SurfaceColumns::SurfaceColumns(Hdf5Writer& writer, std::int64_t start_ns)
    : writer_(writer), start_ns_(start_ns) {
  using T = Hdf5Type;
  const auto add = [&](const char* name, T type, bool three, const char* meaning,
                       std::uint64_t rows = kRows) {
    Hdf5Column column{std::string("/surface/") + name, type, {}, meaning};
    if (three) {
      column.row_shape = {3};
    }
    return writer_.add_column(column, rows);
  };
  rest_ = add("rest_W_m", T::kFloat32, true,
              "vertices at rest: shape_vertices rows of each shape, one shape after the other",
              kVertexRows);
  corners_ = add("corners", T::kUint32, true,
                 "corners of the triangles, counter-clockwise seen from outside: shape_triangles "
                 "rows of each shape",
                 kVertexRows);
  shape_ = {add("shape_time_s", T::kFloat64, false, "when the shape came to this program"),
            add("shape_object", T::kUint8, false, "number of the object"),
            add("shape_epoch", T::kUint32, false,
                "another one whenever the object's vertices or triangles change"),
            add("shape_vertices", T::kUint32, false, "rows of rest_W_m"),
            add("shape_triangles", T::kUint32, false, "rows of corners")};
  value_ = add("vertex_value", T::kUint16, true,
               "vertices of the frames: position in W = frame_low_W_m + frame_step_m * value; "
               "frame_vertices rows of each frame, one frame after the other",
               kVertexRows);
  frame_ = {add("frame_time_s", T::kFloat64, false, "when the frame came to this program"),
            add("frame_simulator_s", T::kFloat64, false, "time of the simulator's clock"),
            add("frame_object", T::kUint8, false, "number of the object"),
            add("frame_epoch", T::kUint32, false, "of the shape that it belongs to"),
            add("frame_vertices", T::kUint32, false, "rows of vertex_value"),
            add("frame_low_W_m", T::kFloat32, true, "smallest coordinates"),
            add("frame_step_m", T::kFloat32, true, "length of a step of vertex_value")};
}

double SurfaceColumns::seconds(std::int64_t time_ns) const noexcept {
  return 1e-9 * static_cast<double>(time_ns - start_ns_);
}

// The vertices come first, so that after a kill each row of the tables has its own.
void SurfaceColumns::write(const RecordedShape& shape) {
  writer_.append(rest_, flat(shape.rest_W_m));
  writer_.append(corners_, flat(shape.corners));
  const std::array<double, 5> numbers{seconds(shape.arrived_ns), static_cast<double>(shape.object),
                                      static_cast<double>(shape.epoch),
                                      static_cast<double>(shape.rest_W_m.size()),
                                      static_cast<double>(shape.corners.size())};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    writer_.append(shape_[i], {numbers[i]});
  }
}

void SurfaceColumns::write(const RecordedFrame& frame) {
  writer_.append(value_, flat(frame.value));
  const std::array<double, 5> numbers{
      seconds(frame.arrived_ns), frame.simulator_s, static_cast<double>(frame.object),
      static_cast<double>(frame.epoch), static_cast<double>(frame.value.size())};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    writer_.append(frame_[i], {numbers[i]});
  }
  writer_.append(frame_[5], flat(frame.low_W_m));
  writer_.append(frame_[6], flat(frame.step_m));
}

}  // namespace forcegrid::tools
