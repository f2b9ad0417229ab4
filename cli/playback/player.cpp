// SPDX-License-Identifier: Apache-2.0
#include "cli/playback/player.h"

#include <algorithm>
#include <limits>
#include <thread>
#include <utility>

namespace forcegrid::cli {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;

constexpr std::size_t kMostCommands = 256;
constexpr milliseconds kStep{5};
constexpr milliseconds kStandingStep{50};
constexpr milliseconds kSay{100};
constexpr milliseconds kArm{16};
constexpr double kMostLag_s = 0.25;
constexpr char kNoServo[] = "a recording is shown: there is no servo that could obey";

}  // namespace

Player::Player(const RecordedRuns& runs, const Options& options)
    : duration_s_(runs.front()->duration_s()) {
  for (const auto& run : runs) {
    if (recorded_surface_ == nullptr && !run->surface().entries().empty()) {
      recorded_surface_ = &run->surface();
    }
  }
  if (recorded_surface_ != nullptr) {
    surface_ = std::make_unique<view_link::FrameSender>(view_link::FrameSender::Options{
        .path = options.surface_socket,
        .most_waiting_bytes =
            kMostWaitingBytes + view_link::kLargestSurfacePayload + view_link::kHeaderBytes,
        .on_frame = {},
        .on_lost = {}});
  }
  for (const auto& run : runs) {
    tools_.emplace_back(*run,
                        PlayedRecording::Options{
                            .feed_socket = options.feed_socket,
                            .on_command = [this, tool = tools_.size()](
                                              const json& command) { take_command(tool, command); },
                            .on_lost =
                                [this] {
                                  const std::lock_guard lock(mutex_);
                                  lost_ = true;
                                  wake_.notify_all();
                                }});
  }
}

std::string Player::play(const std::function<bool()>& stop) {
  hold_clock(0.0);
  send_surface();
  say_state();
  while (!stop()) {
    if (wanted_s_) {
      seek(*std::exchange(wanted_s_, std::nullopt), stop);
    } else if (state_ == State::kPlaying) {
      play_on(stop);
    }
    std::unique_lock lock(mutex_);
    wake_.wait_for(lock, state_ == State::kPlaying ? kStep : kStandingStep,
                   [this] { return lost_ || !commands_.empty(); });
    if (lost_) {
      return "forcegrid-view is gone";
    }
    while (!commands_.empty()) {
      const Command command = std::move(commands_.front());
      commands_.pop_front();
      obey(command);
    }
  }
  return "";
}

// What is due by now.
void Player::play_on(const std::function<bool()>& stop) {
  const double due_s = now_s();
  const double until_s = due_s >= duration_s_ ? std::numeric_limits<double>::infinity() : due_s;
  for (PlayedRecording& tool : tools_) {
    if (!tool.send_before(until_s, stop)) {
      return;
    }
  }
  if (now_s() - due_s > kMostLag_s * speed_) {
    hold_clock(due_s);  // the view is slower than this speed
  }
  if (over()) {
    state_ = State::kPaused;
    hold_clock(duration_s_);
    send_arms();
    send_surface();
    return say_state();
  }
  if (Clock::now() - arm_at_ >= kArm) {
    send_arms();
    send_surface();
  }
  if (Clock::now() - said_at_ >= kSay) {
    say_state();
  }
}

bool Player::over() const {
  return std::all_of(tools_.begin(), tools_.end(),
                     [](const PlayedRecording& tool) { return tool.over(); });
}

bool Player::send_all(const std::function<bool()>& stop) {
  const double step_s = 1e-3 * static_cast<double>(kArm.count());
  for (double time_s = 0.0; !over(); time_s += step_s) {
    if (!send_surfaces_until(time_s, stop)) {
      return false;
    }
    for (PlayedRecording& tool : tools_) {
      const std::size_t before = tool.sent_cycles();
      if (!tool.send_before(time_s + 1e-9, stop)) {
        return false;
      }
      if (tool.sent_cycles() != before) {
        tool.send_arm(false);
      }
    }
  }
  return send_surfaces_until(std::numeric_limits<double>::infinity(), stop);
}

bool Player::send_surfaces_until(double time_s, const std::function<bool()>& stop) {
  if (recorded_surface_ == nullptr) {
    return true;
  }
  const auto& entries = recorded_surface_->entries();
  for (; next_surface_ < entries.size() && entries[next_surface_].time_s <= time_s;
       ++next_surface_) {
    if (!wait_for_room(*surface_, stop)) {
      return false;
    }
    surface_->push(recorded_surface_->frame(next_surface_));
  }
  return true;
}

void Player::end(const std::string& why, int exit_status) {
  for (PlayedRecording& tool : tools_) {
    tool.end(why, exit_status);
  }
}

bool Player::finish(double timeout_s) {
  const auto waits = [](const view_link::FrameSender& sender) {
    return sender.waiting_bytes() > 0 && !sender.lost();
  };
  const auto any_waits = [&] {
    return (surface_ && waits(*surface_)) ||
           std::any_of(tools_.begin(), tools_.end(),
                       [&](const PlayedRecording& tool) { return waits(tool.feed()); });
  };
  const auto end = Clock::now() + std::chrono::duration<double>(timeout_s);
  while (any_waits()) {
    if (Clock::now() >= end) {
      return false;
    }
    std::this_thread::sleep_for(milliseconds(2));
  }
  return true;
}

// ---- What the person wants ----

// On a sender's thread.
void Player::take_command(std::size_t tool, const json& command) {
  const std::lock_guard lock(mutex_);
  if (commands_.size() < kMostCommands) {
    commands_.push_back({tool, command});
    wake_.notify_all();
  }
}

void Player::obey(const Command& command) {
  const std::string what = command.what.value("what", "");
  if (what == "play") {
    const double time_s = now_s();
    speed_ = command.what.value("speed", 1.0);
    state_ = command.what.value("value", false) ? State::kPlaying : State::kPaused;
    hold_clock(time_s);
    if (state_ == State::kPlaying && over() && !wanted_s_) {
      wanted_s_ = 0.0;  // from the end it begins again
    }
    say_state();
  } else if (what == "seek") {
    wanted_s_ = command.what.value("time_s", 0.0);
  } else if (what != "shown") {
    tools_[command.tool].refuse(command.what, kNoServo);
  }
}

// Is a newer place wanted than the one that is looked for?
bool Player::another_place_is_wanted() {
  const std::lock_guard lock(mutex_);
  return std::any_of(commands_.begin(), commands_.end(), [](const Command& command) {
    return command.what.value("what", "") == "seek";
  });
}

void Player::seek(double time_s, const std::function<bool()>& stop) {
  time_s = std::min(time_s, duration_s_);
  json playback = state_now();
  playback["state"] = "seeking";
  playback["time_s"] = time_s;
  for (PlayedRecording& tool : tools_) {
    tool.begin_seek(time_s, playback);
  }
  for (PlayedRecording& tool : tools_) {
    while (tool.seek_on(stop)) {
      if (another_place_is_wanted()) {
        return;
      }
    }
    if (stop() || another_place_is_wanted()) {
      return;
    }
  }
  hold_clock(tools_.size() == 1 ? tools_.front().target_s() : time_s);
  send_arms();
  send_surface();
  say_state();
}

// ---- Frames ----

void Player::send_arms() {
  arm_at_ = Clock::now();
  for (PlayedRecording& tool : tools_) {
    tool.send_arm(true);
  }
}

// The surfaces at this moment, of which only what changed is sent.
void Player::send_surface() {
  if (!surface_) {
    return;
  }
  double time_s = 0.0;
  for (const PlayedRecording& tool : tools_) {
    time_s = std::max(time_s, tool.sent_s());
  }
  const std::vector<std::size_t> shown = recorded_surface_->shown_at(time_s);
  for (const std::size_t entry : shown) {
    if (std::find(shown_.begin(), shown_.end(), entry) == shown_.end()) {
      const view_link::Frame frame = recorded_surface_->frame(entry);
      recorded_surface_->entries()[entry].is_shape ? surface_->push(frame)
                                                   : surface_->push_newest(frame);
    }
  }
  shown_ = shown;
}

json Player::state_now() const {
  return {{"state", state_ == State::kPlaying ? "playing" : "paused"},
          {"time_s", now_s()},
          {"speed", speed_}};
}

void Player::say_state() {
  said_at_ = Clock::now();
  const json playback = state_now();
  for (PlayedRecording& tool : tools_) {
    tool.say(playback);
  }
}

// ---- The clock ----

// [s] Of the recordings, by now.
double Player::now_s() const {
  const double since_s = std::chrono::duration<double>(Clock::now() - held_at_).count();
  return std::min(duration_s_, held_s_ + (state_ == State::kPlaying ? speed_ * since_s : 0.0));
}

void Player::hold_clock(double time_s) {
  held_s_ = time_s;
  held_at_ = Clock::now();
}

}  // namespace forcegrid::cli
