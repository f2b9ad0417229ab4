// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "link/messages.h"
#include "rt/clock.h"
#include "servo_loop/servo_loop.h"
#include "tools/surface_recorder.h"

namespace forcegrid::tools {

struct RecorderOptions {
  std::string file;
  double rate_Hz = 500.0;
  std::vector<std::string> method_names;  ///< in the loop's order
  /// Facts about the whole run: settings, versions, device.
  std::vector<std::pair<std::string, std::string>> attributes;
  bool surface = false;      ///< push() gets shapes and frames of surfaces, too
  bool other_tools = false;  ///< push() gets where the other tools are, too
  /// Recording ends before the free space falls below this [bytes].
  std::uintmax_t keep_free_bytes = 64 << 20;
  /// Returns the free space [bytes] of the disk that holds `file`; tests supply their own.
  std::function<std::uintmax_t(const std::string& file)> free_bytes;
  /// Called at once, on the recorder's thread, if recording must end before the run does.
  std::function<void(const std::string& sentence)> trouble;
};

/// Where another tool of the simulation is, as the simulator said.
struct RecordedTool {
  std::int64_t arrived_ns = 0;  ///< CLOCK_MONOTONIC, of the message that said so
  link::OtherTool tool;
};

/// Outcome of a recording.
struct RecorderEnd {
  std::uint64_t cycles = 0;   ///< in the file
  std::uint64_t samples = 0;  ///< in the file
  std::uint64_t cycles_lost = 0;
  std::uint64_t samples_lost = 0;             ///< and positions of other tools
  std::uint64_t surface_frames = 0;           ///< in the file
  std::uint64_t surface_frames_left_out = 0;  ///< to keep the file small, see SurfaceBound
  bool closed = false;                        ///< properly; otherwise the file is as after a kill
  std::string trouble;  ///< empty, or the reason why it ended early or is incomplete
};

/// Writes every cycle and every simulator sample to HDF5 on a separate thread; see
/// docs/recording.md. push() only appends to a bounded queue. The servo does not call it: its
/// records come through the ring that telemetry drains. Data are written and flushed once per
/// second, so a kill loses about one second.
/// Real-time: no. Threads: push() from any; finish() from the thread that constructed it.
class Recorder {
 public:
  /// Largest number of queued cycles and of queued samples: 16 s at 4 kHz, 40 MB.
  static constexpr std::size_t kLargestQueue = 65'536;
  /// Of queued vertices: several seconds of what SurfaceBound lets through.
  static constexpr std::size_t kMostSurfaceBytes = std::size_t{64} << 20;

  /// Creates the file and starts the thread.
  /// @throws Hdf5Error if the file can't be created.
  explicit Recorder(RecorderOptions options);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  void push(const servo::CycleRecord& cycle);
  void push(const servo::ArrivedSample& sample);
  void push(const RecordedTool& tool);
  void push(RecordedShape shape);
  void push(RecordedFrame frame);

  /// CLOCK_MONOTONIC of time zero in the file.
  std::int64_t start_ns() const noexcept { return start_ns_; }
  /// Empty, or the reason why it has already ended.
  std::string trouble_so_far() const;

  /// Writes the queue, closes the file and joins the thread. Idempotent.
  const RecorderEnd& finish();

 private:
  class Pages;
  void write_until_end();
  struct Surfaces {
    std::vector<RecordedShape> shapes;
    std::vector<RecordedFrame> frames;
  };
  void write(const std::vector<servo::CycleRecord>& cycles,
             const std::vector<servo::ArrivedSample>& samples,
             const std::vector<RecordedTool>& other_tools, const Surfaces& surfaces);
  void give_up(const std::string& sentence);

  RecorderOptions options_;
  std::int64_t start_ns_;
  std::unique_ptr<Pages> pages_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<servo::CycleRecord> cycles_;
  std::vector<servo::ArrivedSample> samples_;
  std::vector<RecordedTool> other_tools_;
  Surfaces surfaces_;
  std::size_t surface_bytes_ = 0;
  SurfaceBound surface_bound_;
  bool end_requested_ = false;
  bool gave_up_ = false;
  RecorderEnd end_;
  std::thread thread_;
};

}  // namespace forcegrid::tools
