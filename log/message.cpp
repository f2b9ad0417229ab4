// SPDX-License-Identifier: Apache-2.0
#include "log/message.h"

#include <array>
#include <cstddef>
#include <cstdio>
#include <ctime>

namespace forcegrid::log {
namespace {

constexpr std::array<const char*, 6> kLevelNames = {"trace", "debug", "info",
                                                    "warn",  "error", "off"};
constexpr std::int64_t kNanoseconds = 1'000'000'000;
constexpr char kReplacement[] = "\xEF\xBF\xBD";  // U+FFFD

// "2026-01-31T12:00:00.123456Z"
std::string utc_text(std::int64_t utc_ns) {
  const std::time_t seconds = utc_ns / kNanoseconds;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  std::array<char, 32> date{};
  std::strftime(date.data(), date.size(), "%Y-%m-%dT%H:%M:%S", &parts);
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%s.%06ldZ", date.data(),
                static_cast<long>(utc_ns % kNanoseconds / 1000));
  return text.data();
}

unsigned byte_at(std::string_view text, std::size_t i) {
  return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U;
}

// How many bytes from `i` on are one character of UTF-8 (RFC 3629); 0: they are none.
std::size_t utf8_length(std::string_view text, std::size_t i) {
  const unsigned first = byte_at(text, i);
  if (first < 0x80) {
    return 1;
  }
  const std::size_t length = first >= 0xC2 && first <= 0xDF   ? 2
                             : first >= 0xE0 && first <= 0xEF ? 3
                             : first >= 0xF0 && first <= 0xF4 ? 4
                                                              : 0;
  for (std::size_t k = 1; k < length; ++k) {
    if ((byte_at(text, i + k) & 0xC0U) != 0x80) {
      return 0;
    }
  }
  // Overlong forms, surrogates, and what is beyond the last character.
  const unsigned second = byte_at(text, i + 1);
  const bool wrong = (first == 0xE0 && second < 0xA0) || (first == 0xED && second > 0x9F) ||
                     (first == 0xF0 && second < 0x90) || (first == 0xF4 && second > 0x8F);
  return wrong ? 0 : length;
}

// As a JSON string (RFC 8259), with its quotation marks.
std::string json_text(std::string_view text) {
  std::string quoted = "\"";
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = utf8_length(text, i);
    const char c = text[i];
    if (length == 0) {
      quoted += kReplacement;
    } else if (c == '"' || c == '\\') {
      quoted += {'\\', c};
    } else if (c == '\n') {
      quoted += "\\n";
    } else if (length == 1 && byte_at(text, i) < 0x20) {
      std::array<char, 8> escape{};
      std::snprintf(escape.data(), escape.size(), "\\u%04x", byte_at(text, i));
      quoted += escape.data();
    } else {
      quoted += text.substr(i, length);
    }
    i += length == 0 ? 1 : length;
  }
  return quoted + '"';
}

std::string repeats_text(const Message& message) {
  return message.repeats == 0 ? ""
                              : " (" + std::to_string(message.repeats) +
                                    (message.repeats == 1 ? " more time)" : " more times)");
}

std::string mark_of(const Message& message) {
  switch (message.level) {
    case Level::kTrace:
    case Level::kDebug:
      return message.component + ": ";
    case Level::kWarn:
      return "Warning: ";
    case Level::kError:
      return message.process.empty() ? "forcegrid: " : "";
    case Level::kInfo:
    case Level::kOff:
      break;
  }
  return "";
}

std::string coloured(const std::string& text, Level level) {
  const bool plain = text.empty() || level < Level::kWarn;
  return plain ? text : (level == Level::kError ? "\033[1;31m" : "\033[1;33m") + text + "\033[0m";
}

}  // namespace

const char* name_of(Level level) { return kLevelNames[static_cast<std::size_t>(level)]; }

std::optional<Level> parse_level(std::string_view name) {
  for (std::size_t i = 0; i < kLevelNames.size(); ++i) {
    if (name == kLevelNames[i]) {
      return static_cast<Level>(i);
    }
  }
  return std::nullopt;
}

std::vector<std::string> level_names() { return {kLevelNames.begin(), kLevelNames.end()}; }

std::string console_line(const Message& message, bool colour) {
  const std::string child = message.process.empty() ? "" : "[" + message.process + "] ";
  const std::string front = child + mark_of(message);
  return (colour ? coloured(front, message.level) : front) + message.text + repeats_text(message);
}

std::string file_line(const Message& message) {
  std::array<char, 64> numbers{};
  std::snprintf(numbers.data(), numbers.size(), " %lld.%09lld %-5s ",
                static_cast<long long>(message.servo_time_ns / kNanoseconds),
                static_cast<long long>(message.servo_time_ns % kNanoseconds),
                name_of(message.level));
  std::string line = utc_text(message.utc_ns) + numbers.data();
  if (!message.process.empty()) {
    line += "[" + message.process + "] ";
  }
  line += message.component + ": ";
  for (const char c : message.text) {
    line += c == '\n' ? std::string("\n    ") : std::string(1, c);
  }
  return line + repeats_text(message);
}

std::string json_line(const Message& message) {
  std::string line =
      "{\"time\":\"" + utc_text(message.utc_ns) +
      "\",\"servo_time_ns\":" + std::to_string(message.servo_time_ns) + ",\"level\":\"" +
      name_of(message.level) + "\",\"process\":" + json_text(message.process) +
      ",\"component\":" + json_text(message.component) + ",\"message\":" + json_text(message.text);
  if (message.repeats > 0) {
    line += ",\"repeats\":" + std::to_string(message.repeats);
  }
  return line + '}';
}

}  // namespace forcegrid::log
