// SPDX-License-Identifier: Apache-2.0
#include "cli/playback/played_recording.h"

#include <algorithm>
#include <cmath>
#include <limits>
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
constexpr double kBucket_s = 0.01;         // of the scope's rows

static_assert(kBatch * sizeof(FeedCycle) <= view_link::kLargestFeedPayload);
static_assert(kSampleBatch * sizeof(FeedSample) <= view_link::kLargestFeedPayload);

std::uint16_t type_of(FeedType type) { return static_cast<std::uint16_t>(type); }

view_link::Frame text_frame(FeedType type, const json& message) {
  return view_link::text_frame(type_of(type),
                               message.dump(-1, ' ', false, json::error_handler_t::replace));
}

}  // namespace

bool wait_for_room(const view_link::FrameSender& sender, const std::function<bool()>& stop) {
  while (sender.waiting_bytes() > kMostWaitingBytes) {
    if (stop() || sender.lost()) {
      return false;
    }
    std::this_thread::sleep_for(milliseconds(1));
  }
  return !stop() && !sender.lost();
}

PlayedRecording::PlayedRecording(RecordedRun& run, const Options& options) : run_(run) {
  view_link::FrameSender::Options feed;
  feed.path = options.feed_socket;
  feed.on_frame = [on_command = options.on_command](const view_link::Frame& frame) {
    if (frame.type != type_of(FeedType::kCommand) ||
        frame.payload.size() > view_link::kLargestCommand) {
      return;
    }
    const json command = json::parse(view_link::text_of(frame), nullptr, false);
    if (command.is_object()) {
      on_command(command);
    }
  };
  feed.on_lost = [on_lost = options.on_lost](const std::string&) { on_lost(); };
  feed_ = std::make_unique<view_link::FrameSender>(std::move(feed));
  view_link::Frame hello = text_frame(FeedType::kHello, run_.hello());
  hello.object = static_cast<std::uint16_t>(run_.place());
  feed_->push(hello);
}

void PlayedRecording::say(const json& playback) {
  feed_->push(text_frame(FeedType::kPlayback, playback));
}

void PlayedRecording::refuse(const json& command, const char* why) {
  feed_->push(text_frame(FeedType::kAcknowledged, {{"id", command.value("id", std::uint64_t{0})},
                                                   {"what", command.value("what", "")},
                                                   {"done", false},
                                                   {"text", why}}));
}

void PlayedRecording::end(const std::string& why, int exit_status) {
  feed_->push(text_frame(FeedType::kEnd,
                         {{"ended_by", "player"}, {"exit_status", exit_status}, {"text", why}}));
}

// ---- Elsewhere ----

void PlayedRecording::begin_seek(double time_s, json playback) {
  target_ = std::min(run_.cycle_at(time_s), run_.cycles() - 1);
  const std::size_t start = start_before(target_);
  if (target_ < next_cycle_ || start > next_cycle_) {
    next_cycle_ = start;
    arrivals_before_ = next_sample_ = start == 0 ? 0 : run_.arrivals_by(start - 1);
    playback["anew"] = {{"missed_deadlines", run_.missed_deadlines_before(start)}};
  }
  say(playback);
}

bool PlayedRecording::seek_on(const std::function<bool()>& stop) {
  return next_cycle_ <= target_ && send_until(std::min(target_ + 1, next_cycle_ + kBatch), stop) &&
         next_cycle_ <= target_;
}

// Where to begin in order to show this cycle: at the beginning of a row of the scope.
std::size_t PlayedRecording::start_before(std::size_t cycle) const {
  if (cycle <= kMostReplayed) {
    return 0;
  }
  const double time_s = run_.seconds_of(cycle - kMostReplayed);
  return run_.cycle_at(kBucket_s * std::ceil(time_s / kBucket_s));
}

// ---- Frames ----

bool PlayedRecording::send_before(double time_s, const std::function<bool()>& stop) {
  return send_until(std::isinf(time_s) ? run_.cycles() : run_.cycle_at(time_s), stop);
}

bool PlayedRecording::send_until(std::size_t end, const std::function<bool()>& stop) {
  while (next_cycle_ < end) {
    if (!wait_for_room(*feed_, stop)) {
      return false;
    }
    send_cycles(std::min(end, next_cycle_ + kBatch));
  }
  return true;
}

void PlayedRecording::send_cycles(std::size_t end) {
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

void PlayedRecording::send_arm(bool newest) {
  if (next_cycle_ > 0) {
    const view_link::Frame arm = run_.arm(next_cycle_ - 1);
    newest ? feed_->push_newest(arm) : feed_->push(arm);
  }
}

}  // namespace forcegrid::cli
