// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace forcegrid::log {

/// How much a message matters, the least first. As a setting: the least that is shown.
enum class Level : std::uint8_t { kTrace, kDebug, kInfo, kWarn, kError, kOff };

/// "trace", "debug", "info", "warn", "error" or "off".
const char* name_of(Level level);
std::optional<Level> parse_level(std::string_view name);
std::vector<std::string> level_names();

/// Where a message of this program appears besides the log file.
enum class Where : std::uint8_t {
  kStderr,
  kStdout,    ///< on stderr with `--log-format json`: then standard output has results alone
  kFileOnly,  ///< the person reads it elsewhere
};

/// Something to say to a person.
struct Message {
  Level level = Level::kInfo;
  std::string component;  ///< the part of the program: "servo", "simulator"
  std::string text;       ///< without a newline at its end
  /// The child process that said it, "simulator" or "run/simulator"; empty: this one.
  std::string process{};
  Where where = Where::kStderr;
  /// The servo's clock (rt::Clock, CLOCK_MONOTONIC), which recordings and the link count in, too.
  /// Zero here and below: now.
  std::int64_t servo_time_ns = 0;
  std::int64_t utc_ns = 0;    ///< wall clock, since 1970
  std::uint64_t repeats = 0;  ///< it was said so often since; 0: this is not a count
};

/// The component of what a child wrote by other means than this library.
inline constexpr char kRawComponent[] = "stderr";

/// For the console: the text, an error behind "forcegrid: ", a warning behind "Warning: ", less
/// than info behind its component, all of a child behind "[CHILD] ".
/// @param colour  the mark of an error or warning is coloured by ANSI sequences.
std::string console_line(const Message& message, bool colour);

/// For a log file: wall clock in UTC, servo's clock in s, level, source and text. A message's
/// further lines are indented, so that each message begins with its time.
std::string file_line(const Message& message);

/// One JSON object on one line, valid for any text: bytes that are no UTF-8 become U+FFFD.
std::string json_line(const Message& message);

}  // namespace forcegrid::log
