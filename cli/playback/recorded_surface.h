// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/hdf5_file.h"
#include "view_link/frame.h"

namespace forcegrid::cli {

/// The surfaces of a recording with --record-surface (docs/recording.md), as a simulator sends them
/// to the live view. Real-time: no. Threads: one at a time.
class RecordedSurface {
 public:
  /// Reads the table of frames and shapes. Without any it is empty.
  /// @param reader  outlives this. @param first_s  [s] of the first cycle since the recording began
  /// @throws tools::Hdf5Error for a damaged file.
  RecordedSurface(const tools::Hdf5Reader& reader, double first_s);

  struct Entry {
    double time_s = 0.0;  ///< since the first cycle
    bool is_shape = false;
    std::uint16_t object = 0;
    std::uint32_t epoch = 0;
    std::size_t row = 0;  ///< of its table
    std::uint64_t first_vertex = 0;
    std::uint32_t vertices = 0;
    std::uint64_t first_triangle = 0;
    std::uint32_t triangles = 0;
  };
  /// Shapes and frames in order of time.
  const std::vector<Entry>& entries() const noexcept { return entries_; }

  /// What shows the surfaces at a time: for each object its newest shape, then its newest frame of
  /// that shape. Indices of entries().
  std::vector<std::size_t> shown_at(double time_s) const;

  /// An entry as the frame of docs/view_protocol.md, with the recording's time for its own.
  /// @throws tools::Hdf5Error for a part that can't be read.
  view_link::Frame frame(std::size_t index) const;

 private:
  void read_shapes(double first_s);
  void read_frames(double first_s);

  const tools::Hdf5Reader& reader_;
  std::vector<Entry> entries_;
};

}  // namespace forcegrid::cli
