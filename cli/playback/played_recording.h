// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "cli/playback/recorded_run.h"
#include "view_link/frame_sender.h"

namespace forcegrid::cli {

/// A recording as the feed that its run would be for the live view (docs/view_protocol.md): what
/// was sent of it, and what comes next. It knows no clock. Real-time: no. Threads: one; the
/// callbacks come on another.
class PlayedRecording {
 public:
  /// Cycles that are replayed before the place that a person goes to: a minute at 500 Hz. The field
  /// is exact if the recording begins there or later.
  static constexpr std::size_t kMostReplayed = 30'000;

  struct Options {
    std::string feed_socket;                                ///< of forcegrid-view
    std::function<void(const nlohmann::json&)> on_command;  ///< a page's
    std::function<void()> on_lost;                          ///< the view has gone away
  };

  /// Connects and says what was recorded. @param run  outlives this.
  /// @throws view_link::ViewLinkError naming the socket.
  PlayedRecording(RecordedRun& run, const Options& options);

  bool over() const noexcept { return next_cycle_ == run_.cycles(); }
  std::size_t sent_cycles() const noexcept { return next_cycle_; }  ///< counted from the first
  /// [s] Of the newest cycle that was sent; 0: none.
  double sent_s() const noexcept {
    return next_cycle_ > 0 ? run_.seconds_of(next_cycle_ - 1) : 0.0;
  }

  /// Sends the cycles before a time with their samples; all of them for infinity.
  /// @returns false if the view is gone, or `stop()` says so.
  /// @throws tools::Hdf5Error for a part of the recording that can't be read.
  bool send_before(double time_s, const std::function<bool()>& stop);
  /// The arm in the newest cycle that was sent. @param newest  in place of one that waits
  void send_arm(bool newest);
  void say(const nlohmann::json& playback);
  /// That a command is not obeyed.
  void refuse(const nlohmann::json& command, const char* why);
  /// The last frame: why nothing more comes.
  void end(const std::string& why, int exit_status);

  /// Begins to go to the cycle at or after a time, or the last one, and says so: `playback`, with
  /// `anew` where it begins anew. To go back, or far ahead, it begins up to kMostReplayed cycles
  /// before the place; so it does for the place where it stands, for who has come since.
  void begin_seek(double time_s, nlohmann::json playback);
  /// Sends a part of what leads there. @returns whether more is to come.
  bool seek_on(const std::function<bool()>& stop);
  /// [s] Of the cycle that it goes to.
  double target_s() const noexcept { return run_.seconds_of(target_); }

  const view_link::FrameSender& feed() const noexcept { return *feed_; }

 private:
  std::size_t start_before(std::size_t cycle) const;
  bool send_until(std::size_t end, const std::function<bool()>& stop);
  void send_cycles(std::size_t end);

  RecordedRun& run_;
  std::size_t next_cycle_ = 0;         ///< that is sent next
  std::size_t next_sample_ = 0;        ///< likewise
  std::uint64_t arrivals_before_ = 0;  ///< that the view was not sent
  std::size_t target_ = 0;             ///< cycle
  std::unique_ptr<view_link::FrameSender> feed_;
};

/// Waits until a view that is slow has taken most of what waits for it.
/// @returns false if the view is gone, or `stop()` says so.
bool wait_for_room(const view_link::FrameSender& sender, const std::function<bool()>& stop);

/// [bytes] That may wait for a view.
inline constexpr std::size_t kMostWaitingBytes = std::size_t{1} << 20;

}  // namespace forcegrid::cli
