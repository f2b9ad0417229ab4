// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace forcegrid::testing {

/// What a dashboard sends to the terminal when it takes the screen, and when it gives it back.
inline constexpr char kEnterScreen[] = "\x1b[?1049h";
inline constexpr char kLeaveScreen[] = "\x1b[?1049l";

/// A program in a terminal of its own, 80 x 24, killed when the test ends.
class InTerminal {
 public:
  /// @param command the program and its arguments.
  explicit InTerminal(std::vector<std::string> command);
  ~InTerminal();
  InTerminal(const InTerminal&) = delete;
  InTerminal& operator=(const InTerminal&) = delete;

  /// Reads until `text` has come, the program has ended, or 30 s. @returns whether it came.
  bool wait_for(const std::string& text);
  /// wait_for() looks at what comes from now on.
  void forget() { from_ = seen_.size(); }
  void send_signal(int number) const;
  /// Waits for its end or halt. @returns whether it is a halt.
  bool wait_until_stopped() const;
  /// Reads to its end. @returns its exit status, 128 + signal; -1 if it does not end.
  int wait();
  /// Reads all that it still says, to its end. @returns whether the screen and the cursor were
  /// given back at last.
  bool gave_the_terminal_back();
  /// All that was read.
  const std::string& seen() const { return seen_; }
  /// What was read after the screen had been given back.
  std::string seen_afterwards() const;

 private:
  pid_t leader_ = -1;  ///< of the terminal's session
  pid_t pid_ = -1;
  int terminal_ = -1;
  std::string seen_;
  std::size_t from_ = 0;
};

}  // namespace forcegrid::testing
