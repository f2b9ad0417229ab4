// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::cli {

/// A child process that runs this program with other arguments. Its standard input and output are
/// pipes; standard error is shared with the parent. It has a separate process group, so Ctrl-C in
/// the terminal reaches only the parent. The kernel kills it when the parent dies.
class ChildProcess {
 public:
  /// @throws std::runtime_error with the system's reason if it can't be started.
  explicit ChildProcess(const std::vector<std::string>& arguments);
  /// Ends the child: closes its input, then sends SIGTERM, then SIGKILL.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Returns the next line of its output without the newline; nothing at the end of the output or
  /// after `timeout`.
  std::optional<std::string> read_line(std::chrono::milliseconds timeout);

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

  pid_t pid_ = -1;
  int to_child_ = -1;
  int from_child_ = -1;
  std::string buffer_;
  std::optional<int> status_;
};

/// Returns the address in the line `listening ADDR:PORT ...` that an emulator or simulator prints
/// first.
/// @param what  for messages: "emulator".
/// @throws std::runtime_error if the line does not arrive within 10 s.
std::string listening_address(ChildProcess& child, const std::string& what);

/// Returns the address and the rest of that line. @throws as listening_address().
std::string listening_line(ChildProcess& child, const std::string& what);

}  // namespace forcegrid::cli
