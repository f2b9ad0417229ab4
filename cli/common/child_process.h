// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "log/message.h"

namespace forcegrid::cli {

struct ChildOptions {
  std::string name;  ///< for people: "simulator"
  /// Its end takes its time, because its last act is to stop motors: it is killed only after 5 s.
  bool drives_motors = false;
  bool announces_start = true;  ///< wait_until_started() is called for it
  /// What it says itself at level info, its own children not counted, is of no interest to whoever
  /// started this process: it has level debug here.
  bool says_details = false;
  /// Another program, a path, which gets the arguments as they are; empty: this program.
  std::string program{};
};

/// A child process that runs this program with other arguments, or another program. Its standard
/// streams are pipes. What it says goes into this process's log as messages of the process NAME, on
/// the console
/// "[NAME] text"; see environment_of_child(). It has a separate process group, so Ctrl-C in the
/// terminal reaches only the parent. The kernel sends it SIGTERM when the parent dies.
class ChildProcess {
 public:
  /// @throws std::runtime_error with the system's reason if it can't be started.
  ChildProcess(const std::vector<std::string>& arguments, ChildOptions options);
  /// Ends the child: closes its input, then sends SIGTERM, then SIGKILL. After a signal to this
  /// process it begins with SIGTERM.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Returns the first line of its output that does not begin with "loading", without the newline.
  /// Such lines say that it is at work; after some seconds they are passed on to people.
  /// Until then, its errors are kept for the exception: they say why it ends.
  /// @throws std::runtime_error if it ends before, with its own reason; if it writes no line for
  ///         10 s; or as soon as this process is to stop (StopRequest).
  std::string wait_until_started();

  /// Returns the next line of its output without the newline; nothing at the end of the output or
  /// after `timeout`.
  std::optional<std::string> read_line(std::chrono::milliseconds timeout);

  /// Asks it to end with SIGTERM; its report can still be read.
  void terminate() noexcept;

  /// Closes its standard input, which asks it to end, and returns the rest of its output. Waits at
  /// most `timeout`.
  std::string finish(std::chrono::milliseconds timeout);

  bool running();
  /// Once the child has ended: how, e.g. "ended with status 3". Empty while it runs, and after
  /// status 0.
  std::string abnormal_end();
  pid_t pid() const noexcept { return pid_; }

 private:
  void reap() noexcept;
  void wait_for_end(std::chrono::steady_clock::time_point deadline) noexcept;
  void pass_on_errors();
  void take_error_line(const std::string& line);
  void say(log::Level level, const std::string& text) const;
  std::string why_not_started();

  ChildOptions options_;
  pid_t pid_ = -1;
  int to_child_ = -1;
  int from_child_ = -1;
  int errors_ = -1;
  std::string buffer_;
  bool output_ended_ = false;
  std::optional<int> status_;
  std::mutex mutex_;    // of the next two
  bool starting_;       ///< what it says of its end is kept, not passed on
  std::string reason_;  ///< that
  std::atomic<bool> over_{false};
  std::thread error_thread_;
};

/// Returns the address in the line `listening ADDR:PORT ...` that an emulator or simulator prints
/// when it is ready. @throws as ChildProcess::wait_until_started().
std::string listening_address(ChildProcess& child);

/// Returns the address and the rest of that line. @throws as listening_address().
std::string listening_line(ChildProcess& child);

}  // namespace forcegrid::cli
