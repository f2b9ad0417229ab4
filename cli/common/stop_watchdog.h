// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <string>
#include <thread>

namespace forcegrid::cli {

/// Ends this process kGrace after the first signal that asks it to (StopRequest), if it has not
/// ended by itself: work in a library may not look at the stop flag for minutes. It removes
/// unfinished files (text::remove_unfinished_files()), says one line on standard error and exits
/// with status_after(the signal). Child processes get SIGTERM from the kernel
/// (ChildProcess). It does not act while an OwnEnd lives, and kGrace begins anew when that ends.
/// Threads: one of its own.
class StopWatchdog {
 public:
  /// @param silent  a parent process speaks for this one, and waits for it: half of kGrace.
  explicit StopWatchdog(bool silent);
  ~StopWatchdog();
  StopWatchdog(const StopWatchdog&) = delete;
  StopWatchdog& operator=(const StopWatchdog&) = delete;

 private:
  void watch() noexcept;

  bool silent_;
  std::atomic<bool> over_{false};
  std::thread thread_;
};

/// While one lives, this process ends only by itself: it may have commanded current to motors,
/// which need a last command of zero, or have files that must be closed. Opening a device commands
/// none. Whoever makes one looks at StopRequest::stop() all the time.
class OwnEnd {
 public:
  OwnEnd() noexcept;
  ~OwnEnd();
  OwnEnd(const OwnEnd&) = delete;
  OwnEnd& operator=(const OwnEnd&) = delete;
};

/// While one lives, StopWatchdog's line ends with the text that the command would have ended it
/// with by itself, if the machine had given it the time.
class StoppedText {
 public:
  /// @param what  of the exception that ends the command, see after_stopped().
  explicit StoppedText(const std::string& what);
  ~StoppedText();
  StoppedText(const StoppedText&) = delete;
  StoppedText& operator=(const StoppedText&) = delete;
};

/// Returns what follows "stopped by SIGINT" in the words of an exception: " while it ran" of
/// "stopped while it ran", "; no path" of "no path".
std::string after_stopped(const std::string& what);

/// Writes "forcegrid: stopped by SIGINT", or what the signal was, and `more` behind it to standard
/// error.
void say_stopped(const std::string& more);

}  // namespace forcegrid::cli
