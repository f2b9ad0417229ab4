// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/playback/recorded_run.h"
#include "view_link/frame_sender.h"

namespace forcegrid::cli {

/// Plays a recording into the live view as a run would feed it (docs/view_protocol.md), and does
/// what a page asks for: play, stand still, go elsewhere.
///
/// The view's copies of the force methods need what came before. To go back, or far ahead, the
/// player begins anew up to kMostReplayed cycles before the place, without waiting for their time.
/// Real-time: no. Threads: run() on one; the view's commands come on another.
class Player {
 public:
  /// Cycles that are replayed before the place that a person goes to: a minute at 500 Hz. The field
  /// is exact if the recording begins there or later.
  static constexpr std::size_t kMostReplayed = 30'000;

  struct Options {
    std::string feed_socket;     ///< of forcegrid-view
    std::string surface_socket;  ///< likewise
  };

  /// Connects and says what was recorded. @param run  outlives this.
  /// @throws view_link::ViewLinkError naming the socket.
  Player(RecordedRun& run, const Options& options);

  /// Plays from the beginning until `stop()` says so, or the view is gone.
  /// @returns why it ended; empty: `stop`.
  /// @throws tools::Hdf5Error for a part of the recording that can't be read.
  std::string play(const std::function<bool()>& stop);

  /// Sends everything as fast as the view takes it, then the end.
  /// @returns false if the view is gone, or `stop()` says so.
  bool send_all(const std::function<bool()>& stop);

  /// The last frame: why nothing more comes.
  void end(const std::string& why, int exit_status);
  /// Waits until what is to be sent is sent, for at most so long. @returns whether it is, or nobody
  /// is there any more.
  bool finish(double timeout_s);

 private:
  using Clock = std::chrono::steady_clock;
  enum class State { kPlaying, kPaused };

  void take_command(const view_link::Frame& frame);
  void obey(const nlohmann::json& command);
  bool another_place_is_wanted();
  void play_on(const std::function<bool()>& stop);
  void seek(double time_s, const std::function<bool()>& stop);
  std::size_t start_before(std::size_t cycle) const;
  bool send_until(std::size_t end, const std::function<bool()>& stop);
  void send_cycles(std::size_t end);
  void send_arm();
  void send_surface();
  nlohmann::json state_now() const;
  void say(const nlohmann::json& playback);
  static bool wait_for_room(const view_link::FrameSender& sender,
                            const std::function<bool()>& stop);
  double now_s() const;
  void hold_clock(double time_s);

  RecordedRun& run_;
  std::mutex mutex_;  ///< of the next three
  std::condition_variable wake_;
  std::deque<nlohmann::json> commands_;
  bool lost_ = false;

  State state_ = State::kPlaying;
  double speed_ = 1.0;
  double held_s_ = 0.0;  ///< time of the recording at held_at_
  Clock::time_point held_at_ = Clock::now();
  std::optional<double> wanted_s_;     ///< where a person wants to go
  std::size_t next_cycle_ = 0;         ///< that is sent next
  std::size_t next_sample_ = 0;        ///< likewise
  std::uint64_t arrivals_before_ = 0;  ///< that the view was not sent
  std::vector<std::size_t> shown_;     ///< entries of the surface
  Clock::time_point said_at_{};        ///< the last state
  Clock::time_point arm_at_{};
  std::unique_ptr<view_link::FrameSender> surface_;
  std::unique_ptr<view_link::FrameSender> feed_;
};

}  // namespace forcegrid::cli
