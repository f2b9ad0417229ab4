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

#include "rt/clock.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::tools {

struct RecorderOptions {
  std::string file;
  double rate_Hz = 500.0;
  std::vector<std::string> method_names;  ///< in the loop's order
  /// Everything about the run that is no number of a cycle: settings, versions, device.
  std::vector<std::pair<std::string, std::string>> attributes;
  /// Recording ends before the disk has less than this left.
  std::uintmax_t keep_free_bytes = 64 << 20;
  /// [bytes] free where `file` is; the tests have their own.
  std::function<std::uintmax_t(const std::string& file)> free_bytes;
  /// Told at once, on the recorder's thread, if recording has to end before the run.
  std::function<void(const std::string& sentence)> trouble;
};

/// What became of a recording.
struct RecorderEnd {
  std::uint64_t cycles = 0;   ///< in the file
  std::uint64_t samples = 0;  ///< in the file
  std::uint64_t cycles_lost = 0;
  std::uint64_t samples_lost = 0;
  bool closed = false;  ///< in order; else it is as a kill would leave it
  std::string trouble;  ///< empty, or why it ended before the run or is not complete
};

/// Writes every cycle and every simulator's sample to HDF5, see docs/recording.md, on a thread of
/// its own: whoever hands over a cycle only appends it to a bounded queue. The servo itself hands
/// over nothing; its records come through the ring that telemetry drains. Written and flushed once
/// a second, so that a kill costs about that. Real-time: no. Threads: push() from any; finish()
/// from the one that constructed.
class Recorder {
 public:
  /// Cycles and samples that may wait for the disk: 16 s of 4 kHz, 40 MB.
  static constexpr std::size_t kLargestQueue = 65'536;

  /// Makes the file and starts the thread.
  /// @throws Hdf5Error when the file can't be made.
  explicit Recorder(RecorderOptions options);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  void push(const servo::CycleRecord& cycle);
  void push(const servo::ArrivedSample& sample);

  /// CLOCK_MONOTONIC of time zero in the file.
  std::int64_t start_ns() const noexcept { return start_ns_; }
  /// Empty, or why it has ended already.
  std::string trouble_so_far() const;

  /// Writes what waits, closes the file, joins. Idempotent.
  const RecorderEnd& finish();

 private:
  class Pages;
  void write_until_told();
  void write(std::vector<servo::CycleRecord>& cycles, std::vector<servo::ArrivedSample>& samples);
  void give_up(const std::string& sentence);

  RecorderOptions options_;
  std::int64_t start_ns_;
  std::unique_ptr<Pages> pages_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<servo::CycleRecord> cycles_;
  std::vector<servo::ArrivedSample> samples_;
  bool told_to_end_ = false;
  bool gave_up_ = false;
  RecorderEnd end_;
  std::thread thread_;
};

}  // namespace forcegrid::tools
