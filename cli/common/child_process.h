#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::cli {

/// This program started again with other arguments, its standard input and output on pipes, in a
/// process group of its own (a Ctrl-C in the terminal reaches only the parent) and killed when the
/// parent dies. Standard error is shared.
class ChildProcess {
 public:
  /// @throws std::runtime_error with the system's reason when it can't be started.
  explicit ChildProcess(const std::vector<std::string>& arguments);
  /// Ends it: end of input, then SIGTERM, then SIGKILL.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// The next line of its output without the newline; nothing at its end or after `timeout`.
  std::optional<std::string> read_line(std::chrono::milliseconds timeout);

  /// Closes its standard input, which asks it to end, and returns the rest of its output, waiting
  /// at most `timeout`.
  std::string finish(std::chrono::milliseconds timeout);

  bool running();
  /// After it ended: a sentence such as "ended with status 3"; empty while it runs or after 0.
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

/// The address in the line `listening ADDR:PORT ...` that an emulator or simulator prints first.
/// @param what  for messages: "emulator".
/// @throws std::runtime_error when it does not come within 10 s.
std::string listening_address(ChildProcess& child, const std::string& what);

/// The same with all that the child says behind the address.
std::string listening_line(ChildProcess& child, const std::string& what);

}  // namespace forcegrid::cli
