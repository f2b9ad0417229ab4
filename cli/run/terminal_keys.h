// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace forcegrid::cli {

/// The emergency key of a user at a terminal: space or e. If standard input is a terminal and this
/// process runs in its foreground, each key is read at once and not echoed. Otherwise there is no
/// emergency key, and nothing is changed.
///
/// The terminal's settings are restored in the destructor, at exit(), at Ctrl-Z (until the process
/// continues), and before the process dies of a signal that it doesn't handle. Ctrl-C keeps its
/// meaning. Handlers installed earlier for these signals are called afterwards. After installing
/// such handlers later, construct a new TerminalKeys.
/// Threads: one; at most one of them exists.
class TerminalKeys {
 public:
  TerminalKeys();
  ~TerminalKeys();
  TerminalKeys(const TerminalKeys&) = delete;
  TerminalKeys& operator=(const TerminalKeys&) = delete;

  bool active() const noexcept { return active_; }

  /// Waits for a key, or for `timeout`. @returns whether it was the emergency key.
  bool emergency_pressed(std::chrono::milliseconds timeout);

 private:
  bool active_ = false;
  bool handlers_ = false;
};

}  // namespace forcegrid::cli
