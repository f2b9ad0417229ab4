// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/hdf5_file.h"

namespace forcegrid::tools {

/// The surface of an object at rest, as a recording keeps it once for each epoch.
struct RecordedShape {
  std::int64_t arrived_ns = 0;  ///< CLOCK_MONOTONIC
  std::uint16_t object = 0;
  std::uint32_t epoch = 0;
  std::vector<std::array<float, 3>> rest_W_m;
  std::vector<std::array<std::uint32_t, 3>> corners;  ///< of the triangles
};

/// The surface at one instant: position_W = low_W_m + step_m * value, for each of x, y, z.
struct RecordedFrame {
  std::int64_t arrived_ns = 0;
  double simulator_s = 0.0;  ///< time of the simulator's clock
  std::uint16_t object = 0;
  std::uint32_t epoch = 0;
  std::array<float, 3> low_W_m{};
  std::array<float, 3> step_m{};
  std::vector<std::array<std::uint16_t, 3>> value;
};

/// Which frames a recording may keep: so many bytes of vertices a second, and in all.
/// Threads: one.
class SurfaceBound {
 public:
  static constexpr double kMost_bytes_per_s = 4e6;
  static constexpr double kMost_bytes = 4e9;

  /// Whether a frame of so many bytes, at this time [s], is to be kept.
  bool take(double time_s, std::size_t bytes) noexcept;

 private:
  double room_bytes_ = kMost_bytes_per_s;  ///< what a second without a frame leaves
  double last_s_ = 0.0;
  double taken_bytes_ = 0.0;
};

/// The columns in the group /surface of a recording; see docs/recording.md. Threads: one.
class SurfaceColumns {
 public:
  /// Adds the columns, before Hdf5Writer::begin(). @param start_ns  CLOCK_MONOTONIC of time zero
  SurfaceColumns(Hdf5Writer& writer, std::int64_t start_ns);

  /// @throws Hdf5Error.
  void write(const RecordedShape& shape);
  void write(const RecordedFrame& frame);

 private:
  double seconds(std::int64_t time_ns) const noexcept;

  Hdf5Writer& writer_;
  std::int64_t start_ns_;
  std::array<std::size_t, 5> shape_{};  ///< columns of /surface/shape_*
  std::array<std::size_t, 7> frame_{};  ///< columns of /surface/frame_*
  std::size_t rest_ = 0;
  std::size_t corners_ = 0;
  std::size_t value_ = 0;
};

}  // namespace forcegrid::tools
