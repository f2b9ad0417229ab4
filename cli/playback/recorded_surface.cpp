// SPDX-License-Identifier: Apache-2.0
#include "cli/playback/recorded_surface.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <map>
#include <string>

#include "view_link/little_endian.h"
#include "view_link/surface_messages.h"

namespace forcegrid::cli {
namespace {

using tools::Hdf5Error;
using tools::Hdf5Reader;
using view_link::SurfaceType;

std::uint64_t common_rows(const Hdf5Reader& reader, std::initializer_list<const char*> columns) {
  std::uint64_t rows = UINT64_MAX;
  for (const char* const column : columns) {
    rows = std::min(rows, reader.rows(column));
  }
  return rows;
}

std::uint32_t count_of(const Hdf5Reader& reader, double number, std::uint32_t most,
                       const char* column) {
  if (!(number >= 0.0 && number <= most)) {
    throw Hdf5Error(reader.file() + ": damaged: " + column + " has a count that is none");
  }
  return static_cast<std::uint32_t>(number);
}

template <typename Number>
void append_as(view_link::Bytes& bytes, const std::vector<double>& numbers) {
  std::vector<Number> narrowed(numbers.size());
  std::transform(numbers.begin(), numbers.end(), narrowed.begin(),
                 [](double number) { return static_cast<Number>(number); });
  view_link::append(bytes, std::span<const Number>(narrowed));
}

}  // namespace

RecordedSurface::RecordedSurface(const Hdf5Reader& reader, double first_s) : reader_(reader) {
  if (!reader_.has("/surface/shape_epoch") || !reader_.has("/surface/frame_epoch")) {
    return;
  }
  read_shapes(first_s);
  read_frames(first_s);
  std::stable_sort(entries_.begin(), entries_.end(),
                   [](const Entry& a, const Entry& b) { return a.time_s < b.time_s; });
}

void RecordedSurface::read_shapes(double first_s) {
  const std::uint64_t rows =
      common_rows(reader_, {"/surface/shape_time_s", "/surface/shape_triangles"});
  const auto numbers = [&](const char* column) { return reader_.numbers(column, rows); };
  const std::vector<double> time_s = numbers("/surface/shape_time_s");
  const std::vector<double> epoch = numbers("/surface/shape_epoch");
  const std::vector<double> object = numbers("/surface/shape_object");
  const std::vector<double> vertices = numbers("/surface/shape_vertices");
  const std::vector<double> triangles = numbers("/surface/shape_triangles");
  const std::uint64_t vertex_rows = reader_.rows("/surface/rest_W_m");
  const std::uint64_t triangle_rows = reader_.rows("/surface/corners");
  std::uint64_t vertex = 0;
  std::uint64_t triangle = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    Entry entry{time_s[row] - first_s, true, 0, 0, row, vertex, 0, triangle, 0};
    entry.object = static_cast<std::uint16_t>(
        count_of(reader_, object[row], UINT16_MAX, "/surface/shape_object"));
    entry.epoch = count_of(reader_, epoch[row], UINT32_MAX, "/surface/shape_epoch");
    entry.vertices =
        count_of(reader_, vertices[row], view_link::kMostVertices, "/surface/shape_vertices");
    entry.triangles =
        count_of(reader_, triangles[row], view_link::kMostTriangles, "/surface/shape_triangles");
    vertex += entry.vertices;
    triangle += entry.triangles;
    if (vertex > vertex_rows || triangle > triangle_rows) {
      return;  // the run was killed while it was written
    }
    entries_.push_back(entry);
  }
}

void RecordedSurface::read_frames(double first_s) {
  const std::uint64_t rows =
      common_rows(reader_, {"/surface/frame_time_s", "/surface/frame_step_m"});
  const auto numbers = [&](const char* column) { return reader_.numbers(column, rows); };
  const std::vector<double> time_s = numbers("/surface/frame_time_s");
  const std::vector<double> epoch = numbers("/surface/frame_epoch");
  const std::vector<double> object = numbers("/surface/frame_object");
  const std::vector<double> vertices = numbers("/surface/frame_vertices");
  const std::uint64_t vertex_rows = reader_.rows("/surface/vertex_value");
  std::uint64_t vertex = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    Entry entry{time_s[row] - first_s, false, 0, 0, row, vertex, 0, 0, 0};
    entry.object = static_cast<std::uint16_t>(
        count_of(reader_, object[row], UINT16_MAX, "/surface/frame_object"));
    entry.epoch = count_of(reader_, epoch[row], UINT32_MAX, "/surface/frame_epoch");
    entry.vertices =
        count_of(reader_, vertices[row], view_link::kMostVertices, "/surface/frame_vertices");
    vertex += entry.vertices;
    if (vertex > vertex_rows) {
      return;
    }
    entries_.push_back(entry);
  }
}

std::vector<std::size_t> RecordedSurface::shown_at(double time_s) const {
  struct Shown {
    std::size_t shape = 0;
    std::size_t frame = 0;
    bool has_frame = false;
  };
  std::map<std::uint16_t, Shown> objects;
  const auto end =
      std::upper_bound(entries_.begin(), entries_.end(), time_s,
                       [](double at_s, const Entry& entry) { return at_s < entry.time_s; });
  for (auto entry = entries_.begin(); entry != end; ++entry) {
    const auto index = static_cast<std::size_t>(entry - entries_.begin());
    if (entry->is_shape) {
      objects[entry->object] = {index, 0, false};
    } else if (const auto shown = objects.find(entry->object);
               shown != objects.end() && entries_[shown->second.shape].epoch == entry->epoch) {
      shown->second.frame = index;
      shown->second.has_frame = true;
    }
  }
  std::vector<std::size_t> found;
  for (const auto& [object, shown] : objects) {
    found.push_back(shown.shape);
    if (shown.has_frame) {
      found.push_back(shown.frame);
    }
  }
  return found;
}

view_link::Frame RecordedSurface::frame(std::size_t index) const {
  const Entry& entry = entries_.at(index);
  view_link::Frame frame{
      static_cast<std::uint16_t>(entry.is_shape ? SurfaceType::kShape : SurfaceType::kFrame),
      entry.object,
      {}};
  view_link::Bytes& bytes = frame.payload;
  view_link::append(bytes, entry.epoch);
  view_link::append(bytes, entry.vertices);
  view_link::append(bytes, entry.triangles);
  if (entry.is_shape) {
    view_link::append(bytes, std::uint32_t{0});
    append_as<float>(bytes,
                     reader_.numbers("/surface/rest_W_m", entry.vertices, entry.first_vertex));
    append_as<std::uint32_t>(
        bytes, reader_.numbers("/surface/corners", entry.triangles, entry.first_triangle));
    return frame;
  }
  view_link::append(bytes, entry.time_s);
  append_as<float>(bytes, reader_.numbers("/surface/frame_low_W_m", 1, entry.row));
  append_as<float>(bytes, reader_.numbers("/surface/frame_step_m", 1, entry.row));
  append_as<std::uint16_t>(
      bytes, reader_.numbers("/surface/vertex_value", entry.vertices, entry.first_vertex));
  return frame;
}

}  // namespace forcegrid::cli
