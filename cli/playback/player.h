// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/playback/played_recording.h"
#include "cli/playback/recorded_run.h"
#include "view_link/frame_sender.h"

namespace forcegrid::cli {

/// Plays the recordings of one run into the live view, one per tool, as the run would feed it
/// (docs/view_protocol.md), by one clock, and does what a page asks for: play, stand still, go
/// elsewhere. The surface is that of the first recording that has one.
///
/// The view's copies of the force methods need what came before a place:
/// PlayedRecording::begin_seek() replays it without waiting for its time.
/// Real-time: no. Threads: run() on one; the view's commands come on another.
class Player {
 public:
  struct Options {
    std::string feed_socket;     ///< of forcegrid-view
    std::string surface_socket;  ///< likewise
  };

  /// Connects and says what was recorded. @param runs  at least one; they outlive this.
  /// @throws view_link::ViewLinkError naming the socket.
  Player(const RecordedRuns& runs, const Options& options);

  /// Plays from the beginning until `stop()` says so, or the view is gone.
  /// @returns why it ended; empty: `stop`.
  /// @throws tools::Hdf5Error for a part of a recording that can't be read.
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
  struct Command {
    std::size_t tool;  ///< whose page sent it
    nlohmann::json what;
  };

  void take_command(std::size_t tool, const nlohmann::json& command);
  void obey(const Command& command);
  bool another_place_is_wanted();
  void play_on(const std::function<bool()>& stop);
  void seek(double time_s, const std::function<bool()>& stop);
  bool over() const;
  void send_arms();
  void send_surface();
  bool send_surfaces_until(double time_s, const std::function<bool()>& stop);
  nlohmann::json state_now() const;
  void say_state();
  double now_s() const;
  void hold_clock(double time_s);

  double duration_s_;
  std::mutex mutex_;  ///< of the next three
  std::condition_variable wake_;
  std::deque<Command> commands_;
  bool lost_ = false;

  State state_ = State::kPlaying;
  double speed_ = 1.0;
  double held_s_ = 0.0;  ///< time of the recordings at held_at_
  Clock::time_point held_at_ = Clock::now();
  std::optional<double> wanted_s_;  ///< where a person wants to go
  std::vector<std::size_t> shown_;  ///< entries of the surface
  std::size_t next_surface_ = 0;    ///< of send_all()
  Clock::time_point said_at_{};     ///< the last state
  Clock::time_point arm_at_{};
  const RecordedSurface* recorded_surface_ = nullptr;
  std::unique_ptr<view_link::FrameSender> surface_;
  std::deque<PlayedRecording> tools_;
};

}  // namespace forcegrid::cli
