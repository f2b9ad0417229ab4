// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "log/message.h"

namespace forcegrid::log {

/// Says a message once that comes again and again, and then how often it came.
///
/// Of this process only what comes again at once is a repeat: "lost, back, lost" is news each time.
/// A child process is one of several alike, as the runs of `tune`, and what one of them has said
/// need not be said of the next. Counts come with the next message, after kPatience, or at the end.
/// Errors and raw lines (kRawComponent) are never held back.
/// Threads: one.
class Repeats {
 public:
  static constexpr std::int64_t kPatience_ns = 60'000'000'000;
  static constexpr std::size_t kRemembered = 64;  ///< different messages of children

  /// @param message  with its time.
  /// @returns what to say now, in this order: counts of earlier messages, and the message itself
  ///          unless it repeats one.
  std::vector<Message> take(const Message& message);
  /// The counts that have not been said.
  std::vector<Message> end();

 private:
  struct Said {
    Message message;
    std::uint64_t again = 0;
    std::int64_t time_ns = 0;
  };
  static void count(Said& said, const Message& message, std::vector<Message>& now);
  static void say_count(Said& said, std::vector<Message>& now);

  std::optional<Said> own_;     // the newest message of this process
  std::vector<Said> children_;  // oldest first
};

}  // namespace forcegrid::log
