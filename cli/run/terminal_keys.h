#pragma once

#include <chrono>

namespace forcegrid::cli {

/// The emergency key of a person at a terminal: space, or e. Where standard input is a terminal in
/// whose foreground this process runs, each key is taken at once and not shown; anywhere else there
/// is no key, and nothing is changed.
///
/// The terminal gets its settings back in the destructor, at exit(), at Ctrl-Z (until the process
/// goes on), and before the process dies of a signal that it doesn't handle. Ctrl-C stays what it
/// is.
/// Handlers of these signals that were there before are called afterwards; whoever installs some
/// later has to make a new TerminalKeys.
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
