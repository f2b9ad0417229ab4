// SPDX-License-Identifier: Apache-2.0
#include "cli/run/simulator_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace forcegrid::cli {
namespace {

// The first line is out within a second; a slow simulator is given two of its periods.
constexpr double kPatience_s = 0.8;
constexpr double kPeriods = 2.0;
constexpr double kLinesEvery_s = 2.0;
constexpr double kMissing_s = 2.0;

// Of the measured period: a single gap changes little.
constexpr double kSmoothing = 0.1;
constexpr double kLongestPeriod_s = 2.0;

std::string tenths_text(double time_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", time_s);
  return text;
}

std::string seconds_text(double time_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f s", time_s);
  return text;
}

}  // namespace

SimulatorWatch::SimulatorWatch(SimulatorWatchOptions options)
    : options_(std::move(options)), period_s_(options_.period_s) {}

void SimulatorWatch::begin(double now_s) noexcept {
  begun_s_ = now_s;
  next_line_s_ = now_s;
}

double SimulatorWatch::patience_s() const noexcept {
  return std::max(kPatience_s, kPeriods * std::max(period_s_, options_.period_s));
}

void SimulatorWatch::measure_period(double sample_s) noexcept {
  if (newest_s_ > 0.0 && sample_s > newest_s_) {
    const double gap_s = std::min(sample_s - newest_s_, kLongestPeriod_s);
    period_s_ += kSmoothing * (gap_s - period_s_);
  }
  newest_s_ = sample_s;
}

std::optional<std::string> SimulatorWatch::update(double now_s, std::optional<double> sample_s,
                                                  bool nobody_listens) {
  if (sample_s) {
    measure_period(*sample_s);
  }
  const double silent_s = now_s - std::max(begun_s_, sample_s.value_or(begun_s_));
  silent_s_ = silent_s;
  if (silent_s <= patience_s()) {
    const bool back = sample_s && state_ == State::kLost;
    state_ = sample_s ? State::kThere : state_;
    return back ? std::optional("samples come from " + options_.address + " again") : std::nullopt;
  }
  silences_ += state_ == State::kThere ? 1 : 0;
  state_ = sample_s ? State::kLost : State::kNever;
  longest_silence_s_ = std::max(longest_silence_s_, silent_s);
  gave_up_ = gave_up_ || (!options_.wait && silent_s >= options_.timeout_s);
  if (now_s < next_line_s_) {
    return std::nullopt;
  }
  next_line_s_ = now_s + kLinesEvery_s;
  return silence_line(silent_s, nobody_listens);
}

bool SimulatorWatch::missing() const noexcept {
  return state_ == State::kNever ||
         (state_ == State::kLost && silent_s_ > std::max(kMissing_s, patience_s()));
}

std::vector<std::string> SimulatorWatch::notes() const {
  std::vector<std::string> notes;
  if (state_ == State::kNever) {
    notes.push_back("no sample came from " + options_.address + "; is a simulator listening there" +
                    (options_.has_key ? " that has this key?" : "?") +
                    " It serves one servo at a time");
  }
  if (silences_ > 0) {
    notes.push_back("the simulator at " + options_.address + " was silent " +
                    (silences_ == 1 ? "once" : std::to_string(silences_) + " times") +
                    ", for at most " + tenths_text(longest_silence_s_) +
                    (state_ == State::kLost ? ", and so it was at the end" : ""));
  }
  return notes;
}

std::string SimulatorWatch::silence_line(double silent_s, bool nobody_listens) const {
  std::string line = state_ == State::kNever ? "no sample from " + options_.address + " yet: "
                                             : "no sample from " + options_.address + " for " +
                                                   seconds_text(silent_s) + ": ";
  if (nobody_listens) {
    line += "nobody listens there; start 'forcegrid simulate --listen " + options_.address + "'";
  } else if (state_ == State::kLost) {
    line += "the simulator is stopped, gone or out of reach";
  } else {
    line +=
        options_.has_key
            ? "is a simulator with this key there? It does not answer to another one"
            : "is a simulator there that takes no key? With a key it answers only to --key FILE";
    line += ", and it serves one servo at a time";
  }
  const double left_s = options_.timeout_s - silent_s;
  line += options_.wait ? ". The run waits for it; Ctrl-C ends it"
                        : ". The run ends in " + seconds_text(std::max(0.0, std::ceil(left_s))) +
                              " (--simulator-timeout)";
  return line;
}

}  // namespace forcegrid::cli
