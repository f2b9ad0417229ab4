#pragma once

#include <atomic>

namespace forcegrid::cli {

/// Counts what asks this process to end: SIGINT (Ctrl-C), SIGTERM and SIGHUP each count one.
/// Threads: any may read; the flags are lock-free and safe in a signal handler.
class StopRequest {
 public:
  /// Installs the handlers. SIGPIPE is ignored: a closed pipe is an error of the write.
  static void install();
  /// True from the first request on.
  static const std::atomic<bool>& stop() noexcept;
  /// True from the second request on, or from the first one after main_part_is_over(): what is
  /// left to do is skipped, too.
  static const std::atomic<bool>& hurry() noexcept;
  /// What follows is only evaluation; one request is enough to skip it.
  static void main_part_is_over() noexcept;
  /// As if a signal had come; for a parent that has closed standard input.
  static void request() noexcept;
};

}  // namespace forcegrid::cli
