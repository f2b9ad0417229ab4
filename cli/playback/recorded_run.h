// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/playback/recorded_surface.h"
#include "driver/mechanism.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_options.h"
#include "tools/hdf5_file.h"
#include "tools/recording.h"
#include "view_link/feed_messages.h"
#include "view_link/frame.h"

namespace forcegrid::cli {

/// What the recordings of one run with several devices share, so that they are shown together.
struct SharedPlace {
  std::size_t place = 0;      ///< of the recording's tool among them, counted from 0
  std::size_t tools = 1;      ///< so many recordings are shown
  std::int64_t first_ns = 0;  ///< of their clock: the earliest first cycle
  std::int64_t last_ns = 0;   ///< of their clock: the latest last cycle
  /// Shapes and frames of the surface that is shown, which one of them has.
  std::size_t surface_frames = 0;
};

/// A recording (docs/recording.md) as what its run would send to the live view. Times are those of
/// the run's clock, as far as the file's doubles hold them.
///
/// Of an old recording, which does not say what the view was told, that is worked out from its
/// settings; it lacks where a virtual coupling's proxy was, so that the field is only about right
/// there, and what it held back.
/// Real-time: no. Threads: one at a time.
class RecordedRun {
 public:
  /// Reads what it holds in full, cycles aside.
  /// @throws tools::Hdf5Error for a file that is no recording, is damaged or has no cycle; other
  ///         exceptions for a device profile or settings that can't be used. All name the file.
  explicit RecordedRun(const std::string& file);
  ~RecordedRun();

  /// As ViewFeed's, with the key `recording`.
  const nlohmann::json& hello() const noexcept { return hello_; }

  /// What tells the run and the tool.
  const std::string& file() const noexcept { return reader_.file(); }
  const tools::RecordingHeader& header() const noexcept { return header_; }
  std::int64_t first_ns() const noexcept { return time_ns_.front(); }
  std::int64_t last_ns() const noexcept { return time_ns_.back(); }
  /// [s] Of the world's clock when the run's clock was zero, to about a second; nothing if the file
  /// does not say when it was begun.
  std::optional<double> clock_zero_utc_s() const;

  /// Shows it together with others: times count from the first cycle of all.
  void share(const SharedPlace& shared);
  std::size_t place() const noexcept { return shared_.place; }

  std::size_t cycles() const noexcept { return time_ns_.size(); }
  /// [s] From the first cycle to the last, of all recordings that are shown.
  double duration_s() const noexcept {
    return 1e-9 * static_cast<double>(shared_.last_ns - shared_.first_ns);
  }
  /// [s] Of a cycle, since the first one of all recordings that are shown.
  double seconds_of(std::size_t cycle) const noexcept {
    return 1e-9 * static_cast<double>(time_ns_[cycle] - shared_.first_ns);
  }
  /// The first cycle at or after such a time; cycles() if there is none.
  std::size_t cycle_at(double time_s) const noexcept;
  std::uint64_t missed_deadlines_before(std::size_t cycle) const;

  /// `count` cycles from `first` on, fewer at the end.
  /// @throws tools::Hdf5Error for a part that can't be read.
  std::vector<view_link::FeedCycle> cycles(std::size_t first, std::size_t count);
  /// The arm in a cycle.
  view_link::Frame arm(std::size_t cycle);
  /// In order of arrival.
  const std::vector<view_link::FeedSample>& samples() const noexcept { return samples_; }
  const RecordedSurface& surface() const noexcept { return *surface_; }
  /// How many samples the methods had got by this cycle.
  std::uint64_t arrivals_by(std::size_t cycle) const noexcept { return arrivals_[cycle]; }

 private:
  struct Block;
  void read_samples();
  void read_hello();
  void read_arrivals();
  void describe_recording();
  nlohmann::json hello_of_old_recording();
  const Block& block_of(std::size_t cycle);
  std::unique_ptr<Block> read_block(std::size_t first);

  tools::Hdf5Reader reader_;
  tools::RecordingHeader header_;
  SharedPlace shared_;
  std::int64_t start_ns_ = 0;  ///< of the recording, on the run's clock
  std::size_t methods_ = 0;
  std::optional<profiles::DeviceProfile> profile_;
  std::unique_ptr<driver::Mechanism> mechanism_;
  servo::WorkspaceMap workspace_;
  nlohmann::json hello_;
  std::vector<std::int64_t> time_ns_;  ///< of the cycles
  std::vector<std::uint64_t> arrivals_;
  std::vector<std::uint32_t> missed_;  ///< deadlines, by the end of each cycle
  std::vector<view_link::FeedSample> samples_;
  std::optional<RecordedSurface> surface_;
  std::vector<std::unique_ptr<Block>> blocks_;  ///< the newest ones that were asked for
};

/// Of one run, by the place of the tool.
using RecordedRuns = std::vector<std::unique_ptr<RecordedRun>>;

}  // namespace forcegrid::cli
