// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "log/log.h"
#include "rt/checkpoint.h"

namespace forcegrid::cli {

/// Formats a duration [s] for people: "42 s", "3 min 05 s", "2 h 10 min".
std::string time_text(double time_s);

/// Where and when a ProgressLine shows.
struct ProgressOptions {
  std::FILE* out = stderr;  ///< any other is a test's, and gets all that the log would get
  /// Whether the line may be rewritten in place.
  bool terminal = is_terminal(stderr);
  /// Nothing is shown before; short work needs no progress.
  std::chrono::milliseconds quiet{3000};
  /// From one line to the next, where lines can't be rewritten.
  std::chrono::milliseconds log_period{10'000};

  static bool is_terminal(std::FILE* stream);
};

/// Shows what long work is doing, how much of it is done and the time left: on a terminal one line
/// that is rewritten, otherwise a line every ten seconds. A thread of its own draws it, so that the
/// time goes on during a long step.
///
/// Lines that can't be rewritten are messages of the log, level info. Where the console does not
/// show that level, nothing appears. The log's own messages go above the line; whoever prints to
/// the same terminal by other means calls pause() or clear() first. The thread blocks all signals.
/// Threads: any.
class ProgressLine {
 public:
  explicit ProgressLine(ProgressOptions options = {});
  /// Clears the line, so that the message of an exception starts on a new line.
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// A step begins whose length is unknown: the line says how long it has taken so far.
  void begin(const std::string& what);
  /// A step begins that lasts `length_s`.
  void begin(const std::string& what, double length_s);
  /// `done` [0, 1] of the work, with `remaining_s` left, which counts down until the next call.
  void show(const std::string& what, double done, double remaining_s);
  /// The same, the time left being estimated from the time since `what` began.
  void show(const std::string& what, double done);
  /// The same for the present step, if there is one.
  void show_done(double done);
  /// Says something, level info; behind "WARNING: " level warn.
  void say(const std::string& text);
  /// Somebody else prints now; the next show() goes on with the same work.
  void pause();
  /// The work is over.
  void clear();
  /// say() and show() as functions; this object must outlive them.
  std::function<void(const std::string&)> say_function();
  std::function<void(const std::string&, double, double)> show_function();

 private:
  using Clock = std::chrono::steady_clock;
  struct State {
    std::string what;
    Clock::time_point begun;
    Clock::time_point told;
    std::optional<double> done;
    std::optional<double> remaining_s;
    bool paused = false;
  };

  void set(const std::string& what, std::optional<double> done, std::optional<double> remaining_s);
  void draw_until_end();
  void draw(const std::string& text);
  void print(const std::string& line);
  void erase_line();
  std::string text_at(Clock::time_point now) const;

  const ProgressOptions options_;
  const bool logs_;  // it says its lines in the log
  std::mutex mutex_;
  std::condition_variable wake_;
  bool ended_ = false;
  bool open_ = false;  // a line that is to be rewritten stands there
  std::optional<State> state_;
  Clock::time_point next_;
  std::optional<log::ConsoleTaker> taker_;  // where the line may be in the way
  std::thread thread_;
};

/// Shows the steps of this thread's work on a line, each with the time left as far as the step's
/// checkpoints tell it; they go on looking at the same request to stop.
/// Threads: as rt::Supervised.
class WorkProgress {
 public:
  explicit WorkProgress(ProgressLine& line) : line_(line) {}

  void begin(const std::string& what);
  /// Clears the line.
  void end();

 private:
  ProgressLine& line_;
  std::optional<rt::Supervised> supervised_;  // of this step
};

}  // namespace forcegrid::cli
