// SPDX-License-Identifier: Apache-2.0
#include "cli/common/progress_line.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>

namespace forcegrid::cli {
namespace {

constexpr std::chrono::milliseconds kRedrawPeriod{200};

// Columns of the terminal; 80 where it does not say.
std::size_t columns_of(std::FILE* stream) {
  winsize size{};
  return ioctl(fileno(stream), TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col : 80;
}

// No line is rewritten between lines of JSON.
ProgressOptions shown_by_log(ProgressOptions options) {
  options.terminal = options.terminal && !(options.out == stderr && log::console_is_json());
  return options;
}

}  // namespace

std::string time_text(double time_s) {
  const long seconds = std::lround(std::clamp(time_s, 0.0, 1e9));
  char text[48];
  if (seconds < 60) {
    std::snprintf(text, sizeof text, "%ld s", seconds);
  } else if (seconds < 3600) {
    std::snprintf(text, sizeof text, "%ld min %02ld s", seconds / 60, seconds % 60);
  } else {
    std::snprintf(text, sizeof text, "%ld h %02ld min", seconds / 3600, seconds % 3600 / 60);
  }
  return text;
}

bool ProgressOptions::is_terminal(std::FILE* stream) { return isatty(fileno(stream)) == 1; }

ProgressLine::ProgressLine(ProgressOptions options)
    : options_(shown_by_log(options)),
      logs_(options.out == stderr),
      next_(Clock::now() + options.quiet) {
  if (logs_ && options_.terminal) {
    taker_.emplace([this](const std::string& line) { print(line); });
  }
  sigset_t all;
  sigset_t before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);  // inherited by the thread
  thread_ = std::thread([this] { draw_until_end(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

ProgressLine::~ProgressLine() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  wake_.notify_one();
  thread_.join();
  taker_.reset();
  erase_line();
}

void ProgressLine::begin(const std::string& what) {
  const std::lock_guard lock(mutex_);
  state_.reset();
  set(what, std::nullopt, std::nullopt);
}

void ProgressLine::begin(const std::string& what, double length_s) {
  const std::lock_guard lock(mutex_);
  state_.reset();
  set(what, std::nullopt, length_s);
}

void ProgressLine::show(const std::string& what, double done, double remaining_s) {
  const std::lock_guard lock(mutex_);
  set(what, done, remaining_s);
}

void ProgressLine::show(const std::string& what, double done) {
  const std::lock_guard lock(mutex_);
  set(what, done, std::nullopt);
}

void ProgressLine::show_done(double done) {
  const std::lock_guard lock(mutex_);
  if (state_) {
    set(std::string(state_->what), done, std::nullopt);
  }
}

void ProgressLine::set(const std::string& what, std::optional<double> done,
                       std::optional<double> remaining_s) {
  const Clock::time_point now = Clock::now();
  const Clock::time_point begun = state_ && state_->what == what ? state_->begun : now;
  state_ = State{what, begun, now, done, remaining_s};
}

void ProgressLine::say(const std::string& text) {
  const std::string warning = "WARNING: ";
  if (!logs_) {
    print(text);
  } else if (text.starts_with(warning)) {
    log::warn("progress", text.substr(warning.size()));
  } else {
    log::info("progress", text);
  }
}

void ProgressLine::print(const std::string& line) {
  const std::lock_guard lock(mutex_);
  erase_line();
  std::fprintf(options_.out, "%s\n", line.c_str());
  std::fflush(options_.out);
}

void ProgressLine::pause() {
  const std::lock_guard lock(mutex_);
  if (state_) {
    state_->paused = true;
  }
  erase_line();
}

void ProgressLine::clear() {
  const std::lock_guard lock(mutex_);
  state_.reset();
  erase_line();
}

void ProgressLine::erase_line() {
  if (open_) {
    std::fputs("\r\033[K", options_.out);
    std::fflush(options_.out);
    open_ = false;
  }
}

std::string ProgressLine::text_at(Clock::time_point now) const {
  const auto since = [now](Clock::time_point time) {
    return std::chrono::duration<double>(now - time).count();
  };
  std::optional<double> done = state_->done;
  std::optional<double> left_s;
  if (state_->remaining_s) {
    left_s = std::max(*state_->remaining_s - since(state_->told), 0.0);
    if (*state_->remaining_s > 0.0) {  // what is done goes on as the time left counts down
      done = 1.0 - (1.0 - done.value_or(0.0)) * *left_s / *state_->remaining_s;
    }
  } else if (done && *done > 0.0) {
    const double took_s = since(state_->begun) - since(state_->told);
    left_s = std::max(took_s * (1.0 / *done - 1.0) - since(state_->told), 0.0);
  }
  const bool longer_than_expected = state_->remaining_s && *left_s <= 0.0;
  if (!done || !left_s || longer_than_expected) {
    return state_->what + ": " + time_text(since(state_->begun)) + " so far";
  }
  char percent[16];
  std::snprintf(percent, sizeof percent, "%3.0f %%", 100.0 * std::clamp(*done, 0.0, 1.0));
  return state_->what + ": " + percent + ", " + time_text(*left_s) + " left";
}

void ProgressLine::draw(const std::string& text) {
  std::fprintf(options_.out, "\r\033[K%s", text.substr(0, columns_of(options_.out) - 1).c_str());
  std::fflush(options_.out);
  open_ = true;
}

void ProgressLine::draw_until_end() {
  std::unique_lock lock(mutex_);
  while (!ended_) {
    const Clock::time_point now = Clock::now();
    const bool hidden = logs_ && !log::console_shows(log::Level::kInfo);
    if (now >= next_ && state_ && !state_->paused && !hidden) {
      next_ = now + (options_.terminal ? kRedrawPeriod : options_.log_period);
      const std::string text = text_at(now);
      if (options_.terminal) {
        draw(text);
      } else {
        lock.unlock();  // the log's lock comes before this one
        say(text);
        lock.lock();
      }
    }
    // Without anything to show yet, looks again soon.
    wake_.wait_until(lock, std::max(next_, now + kRedrawPeriod / 2), [this] { return ended_; });
  }
}

std::function<void(const std::string&)> ProgressLine::say_function() {
  return [this](const std::string& text) { say(text); };
}

std::function<void(const std::string&, double, double)> ProgressLine::show_function() {
  return [this](const std::string& what, double done, double remaining_s) {
    show(what, done, remaining_s);
  };
}

void WorkProgress::begin(const std::string& what) {
  line_.begin(what);
  supervised_.reset();
  supervised_.emplace(rt::Supervision{.stop = rt::supervising_stop(),
                                      .alive =
                                          [&line = line_](std::optional<double> done) {
                                            if (done) {
                                              line.show_done(*done);
                                            }
                                          },
                                      .period = kRedrawPeriod});
}

void WorkProgress::end() {
  supervised_.reset();
  line_.clear();
}

}  // namespace forcegrid::cli
