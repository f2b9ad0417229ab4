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
#include "view_link/feed_messages.h"
#include "view_link/frame.h"

namespace forcegrid::cli {

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

  std::size_t cycles() const noexcept { return time_ns_.size(); }
  /// [s] From the first cycle to the last.
  double duration_s() const noexcept { return seconds_of(time_ns_.size() - 1); }
  /// [s] Of a cycle, since the first.
  double seconds_of(std::size_t cycle) const noexcept {
    return 1e-9 * static_cast<double>(time_ns_[cycle] - time_ns_[0]);
  }
  /// The first cycle at or after a time since the first; cycles() if there is none.
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
  nlohmann::json hello_of_old_recording();
  const Block& block_of(std::size_t cycle);
  std::unique_ptr<Block> read_block(std::size_t first);

  tools::Hdf5Reader reader_;
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

}  // namespace forcegrid::cli
