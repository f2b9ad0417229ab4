// SPDX-License-Identifier: Apache-2.0
#include "cli/playback/player.h"

#include <algorithm>
#include <cmath>
#include <thread>
#include <utility>

#include "view_link/little_endian.h"

namespace forcegrid::cli {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using view_link::FeedCycle;
using view_link::FeedSample;
using view_link::FeedType;

constexpr std::size_t kBatch = 128;        // cycles of a frame, which holds 64 KiB
constexpr std::size_t kSampleBatch = 256;  // likewise
constexpr std::size_t kMostWaitingBytes = std::size_t{1} << 20;
constexpr std::size_t kMostCommands = 256;
constexpr milliseconds kStep{5};
constexpr milliseconds kStandingStep{50};
constexpr milliseconds kSay{100};
constexpr milliseconds kArm{16};
constexpr double kBucket_s = 0.01;  // of the scope's rows
constexpr double kMostLag_s = 0.25;
constexpr char kNoServo[] = "a recording is shown: there is no servo that could obey";

static_assert(kBatch * sizeof(FeedCycle) <= view_link::kLargestFeedPayload);
static_assert(kSampleBatch * sizeof(FeedSample) <= view_link::kLargestFeedPayload);

std::uint16_t type_of(FeedType type) { return static_cast<std::uint16_t>(type); }

std::string text_of(const json& message) {
  return message.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace

Player::Player(RecordedRun& run, const Options& options) : run_(run) {
  if (!run_.surface().entries().empty()) {
    surface_ = std::make_unique<view_link::FrameSender>(view_link::FrameSender::Options{
        .path = options.surface_socket,
        .most_waiting_bytes =
            kMostWaitingBytes + view_link::kLargestSurfacePayload + view_link::kHeaderBytes,
        .on_frame = {},
        .on_lost = {}});
  }
  view_link::FrameSender::Options feed;
  feed.path = options.feed_socket;
  feed.on_frame = [this](const view_link::Frame& frame) { take_command(frame); };
  feed.on_lost = [this](const std::string&) {
    const std::lock_guard lock(mutex_);
    lost_ = true;
    wake_.notify_all();
  };
  feed_ = std::make_unique<view_link::FrameSender>(std::move(feed));
  feed_->push(view_link::text_frame(type_of(FeedType::kHello), text_of(run_.hello())));
}

std::string Player::play(const std::function<bool()>& stop) {
  hold_clock(0.0);
  send_surface();
  say(state_now());
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
      const json command = std::move(commands_.front());
      commands_.pop_front();
      obey(command);
    }
  }
  return "";
}

// What is due by now.
void Player::play_on(const std::function<bool()>& stop) {
  const double due_s = now_s();
  const bool over = due_s >= run_.duration_s();
  if (!send_until(over ? run_.cycles() : run_.cycle_at(due_s), stop)) {
    return;
  }
  if (now_s() - due_s > kMostLag_s * speed_) {
    hold_clock(due_s);  // the view is slower than this speed
  }
  if (next_cycle_ == run_.cycles()) {
    state_ = State::kPaused;
    hold_clock(run_.duration_s());
    send_arm();
    send_surface();
    return say(state_now());
  }
  if (Clock::now() - arm_at_ >= kArm) {
    send_arm();
    send_surface();
  }
  if (Clock::now() - said_at_ >= kSay) {
    say(state_now());
  }
}

bool Player::send_all(const std::function<bool()>& stop) {
  const auto& surface = run_.surface().entries();
  std::size_t next_surface = 0;
  const double step_s = 1e-3 * static_cast<double>(kArm.count());
  for (double time_s = 0.0; next_cycle_ < run_.cycles(); time_s += step_s) {
    for (; next_surface < surface.size() && surface[next_surface].time_s <= time_s;
         ++next_surface) {
      if (!wait_for_room(*surface_, stop)) {
        return false;
      }
      surface_->push(run_.surface().frame(next_surface));
    }
    const std::size_t before = next_cycle_;
    if (!send_until(run_.cycle_at(time_s + 1e-9), stop)) {
      return false;
    }
    if (next_cycle_ != before) {
      feed_->push(run_.arm(next_cycle_ - 1));
    }
  }
  for (; next_surface < surface.size(); ++next_surface) {
    if (!wait_for_room(*surface_, stop)) {
      return false;
    }
    surface_->push(run_.surface().frame(next_surface));
  }
  return true;
}

void Player::end(const std::string& why, int exit_status) {
  feed_->push(view_link::text_frame(
      type_of(FeedType::kEnd),
      text_of({{"ended_by", "player"}, {"exit_status", exit_status}, {"text", why}})));
}

bool Player::finish(double timeout_s) {
  const auto waits = [](const std::unique_ptr<view_link::FrameSender>& sender) {
    return sender && sender->waiting_bytes() > 0 && !sender->lost();
  };
  const auto end = Clock::now() + std::chrono::duration<double>(timeout_s);
  while (waits(feed_) || waits(surface_)) {
    if (Clock::now() >= end) {
      return false;
    }
    std::this_thread::sleep_for(milliseconds(2));
  }
  return true;
}

// ---- What the person wants ----

// On the sender's thread.
void Player::take_command(const view_link::Frame& frame) {
  if (frame.type != type_of(FeedType::kCommand) ||
      frame.payload.size() > view_link::kLargestCommand) {
    return;
  }
  json command = json::parse(view_link::text_of(frame), nullptr, false);
  if (!command.is_object()) {
    return;
  }
  const std::lock_guard lock(mutex_);
  if (commands_.size() < kMostCommands) {
    commands_.push_back(std::move(command));
    wake_.notify_all();
  }
}

void Player::obey(const json& command) {
  const std::string what = command.value("what", "");
  if (what == "play") {
    const double time_s = now_s();
    speed_ = command.value("speed", 1.0);
    state_ = command.value("value", false) ? State::kPlaying : State::kPaused;
    hold_clock(time_s);
    if (state_ == State::kPlaying && next_cycle_ == run_.cycles() && !wanted_s_) {
      wanted_s_ = 0.0;  // from the end it begins again
    }
    say(state_now());
  } else if (what == "seek") {
    wanted_s_ = command.value("time_s", 0.0);
  } else if (what != "shown") {
    const json refusal = {{"id", command.value("id", std::uint64_t{0})},
                          {"what", what},
                          {"done", false},
                          {"text", kNoServo}};
    feed_->push(view_link::text_frame(type_of(FeedType::kAcknowledged), text_of(refusal)));
  }
}

// Is a newer place wanted than the one that is looked for?
bool Player::another_place_is_wanted() {
  const std::lock_guard lock(mutex_);
  return std::any_of(commands_.begin(), commands_.end(),
                     [](const json& command) { return command.value("what", "") == "seek"; });
}

void Player::seek(double time_s, const std::function<bool()>& stop) {
  const std::size_t target = std::min(run_.cycle_at(time_s), run_.cycles() - 1);
  const std::size_t start = start_before(target);
  const bool anew = target + 1 < next_cycle_ || start > next_cycle_;
  json playback = state_now();
  playback["state"] = "seeking";
  playback["time_s"] = run_.seconds_of(target);
  if (anew) {
    next_cycle_ = start;
    arrivals_before_ = next_sample_ = start == 0 ? 0 : run_.arrivals_by(start - 1);
    playback["anew"] = {{"missed_deadlines", run_.missed_deadlines_before(start)}};
  }
  say(playback);
  while (next_cycle_ <= target) {
    if (!send_until(std::min(target + 1, next_cycle_ + kBatch), stop) ||
        another_place_is_wanted()) {
      return;
    }
  }
  hold_clock(run_.seconds_of(target));
  send_arm();
  send_surface();
  say(state_now());
}

// Where to begin in order to show this cycle: at the beginning of a row of the scope.
std::size_t Player::start_before(std::size_t cycle) const {
  if (cycle <= kMostReplayed) {
    return 0;
  }
  const double time_s = run_.seconds_of(cycle - kMostReplayed);
  return run_.cycle_at(kBucket_s * std::ceil(time_s / kBucket_s));
}

// ---- Frames ----

// Sends the cycles before `end`, with their samples. False: stop, or the view is gone.
bool Player::send_until(std::size_t end, const std::function<bool()>& stop) {
  while (next_cycle_ < end) {
    if (!wait_for_room(*feed_, stop)) {
      return false;
    }
    send_cycles(std::min(end, next_cycle_ + kBatch));
  }
  return true;
}

void Player::send_cycles(std::size_t end) {
  std::vector<FeedCycle> cycles = run_.cycles(next_cycle_, end - next_cycle_);
  for (FeedCycle& cycle : cycles) {
    cycle.arrivals_taken -= arrivals_before_;
  }
  const auto& samples = run_.samples();
  const std::size_t samples_end = std::max<std::size_t>(next_sample_, run_.arrivals_by(end - 1));
  while (next_sample_ < samples_end) {
    const std::size_t count = std::min(kSampleBatch, samples_end - next_sample_);
    view_link::Frame frame{type_of(FeedType::kSamples), 0, {}};
    view_link::append(frame.payload,
                      std::span<const FeedSample>(samples.data() + next_sample_, count));
    next_sample_ += count;
    feed_->push(frame);
  }
  view_link::Frame frame{type_of(FeedType::kCycles), 0, {}};
  view_link::append(frame.payload, std::span<const FeedCycle>(cycles));
  next_cycle_ = end;
  feed_->push(frame);
}

void Player::send_arm() {
  arm_at_ = Clock::now();
  if (next_cycle_ > 0) {
    feed_->push_newest(run_.arm(next_cycle_ - 1));
  }
}

// The surfaces at this moment, of which only what changed is sent.
void Player::send_surface() {
  if (!surface_) {
    return;
  }
  const double time_s = next_cycle_ > 0 ? run_.seconds_of(next_cycle_ - 1) : 0.0;
  const std::vector<std::size_t> shown = run_.surface().shown_at(time_s);
  for (const std::size_t entry : shown) {
    if (std::find(shown_.begin(), shown_.end(), entry) == shown_.end()) {
      const view_link::Frame frame = run_.surface().frame(entry);
      run_.surface().entries()[entry].is_shape ? surface_->push(frame)
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

void Player::say(const json& playback) {
  said_at_ = Clock::now();
  feed_->push(view_link::text_frame(type_of(FeedType::kPlayback), text_of(playback)));
}

// False: stop, or the view is gone.
bool Player::wait_for_room(const view_link::FrameSender& sender,
                           const std::function<bool()>& stop) {
  while (sender.waiting_bytes() > kMostWaitingBytes) {
    if (stop() || sender.lost()) {
      return false;
    }
    std::this_thread::sleep_for(milliseconds(1));
  }
  return !stop() && !sender.lost();
}

// ---- The clock ----

// [s] Of the recording, by now.
double Player::now_s() const {
  const double since_s = std::chrono::duration<double>(Clock::now() - held_at_).count();
  return std::min(run_.duration_s(),
                  held_s_ + (state_ == State::kPlaying ? speed_ * since_s : 0.0));
}

void Player::hold_clock(double time_s) {
  held_s_ = time_s;
  held_at_ = Clock::now();
}

}  // namespace forcegrid::cli
