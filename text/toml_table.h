// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "text/toml_parser.h"

namespace forcegrid::text {

/// Which values a number may have, and what to write: "a length in metres from 0.0001 to 2".
struct NumberRange {
  double min;
  double max;
  const char* words;
};

inline constexpr double kLargestNumber = std::numeric_limits<double>::max();
inline constexpr double kAboveZero = std::numeric_limits<double>::min();

/// One table of a strict TOML file. It knows its keys, so that an unknown or missing one is an
/// error. Every error is a TomlError that names file, line and key, says what is wrong and what to
/// write, and for an unknown key names the nearest known one.
///
/// This header is private: it includes toml++. Real-time: no. Threads: one.
class TomlTable {
 public:
  /// @param path  of the table in the file, for messages; empty: the file itself.
  /// @throws TomlError for a key that is not one of `keys`.
  TomlTable(const toml::table& table, std::string file, std::string path,
            const std::vector<std::string>& keys);

  bool has(std::string_view key) const { return table_.get(key) != nullptr; }
  const std::string& file() const { return file_; }
  std::uint32_t line_of(std::string_view key) const;

  /// @throws TomlError when the key is missing, of another type or out of range.
  TomlTable table(const char* key, const std::vector<std::string>& keys) const;
  /// [[key]]: at least one table. `keys_of` returns the keys that a given table may have.
  std::vector<TomlTable> tables(
      const char* key,
      const std::function<std::vector<std::string>(const TomlTable&)>& keys_of) const;
  std::string text(const char* key, std::size_t max_length = 1000) const;
  bool flag(const char* key) const;
  double number(const char* key, const NumberRange& range) const;
  std::int64_t integer(const char* key, std::int64_t min, std::int64_t max) const;
  std::array<double, 3> axes(const char* key, const NumberRange& range) const;
  /// Three numbers in an array, or one number for all three.
  std::array<double, 3> axes_or_number(const char* key, const NumberRange& range) const;
  std::vector<std::int64_t> integers(const char* key, std::size_t count, std::int64_t min,
                                     std::int64_t max) const;

  /// The same for an optional key.
  std::string text_or(const char* key, const std::string& otherwise) const;
  bool flag_or(const char* key, bool otherwise) const;
  double number_or(const char* key, const NumberRange& range, double otherwise) const;
  std::int64_t integer_or(const char* key, std::int64_t min, std::int64_t max,
                          std::int64_t otherwise) const;
  std::array<double, 3> axes_or(const char* key, const NumberRange& range,
                                const std::array<double, 3>& otherwise) const;

  /// Throws TomlError for a value that the caller finds wrong.
  [[noreturn]] void refuse(std::string_view key, const std::string& problem,
                           const std::string& remedy) const;

 private:
  TomlTable(const toml::table& table, std::string file, std::string path);

  void refuse_others(const std::vector<std::string>& keys) const;
  std::string full(std::string_view key) const;
  std::uint32_t table_line() const;
  const toml::node& required(const char* key, const std::string& what) const;
  const toml::array& array_of(const char* key, std::size_t size, const std::string& words) const;
  double number_of(const toml::node& node, const char* key, const NumberRange& range,
                   const std::string& place) const;
  std::int64_t integer_of(const toml::node& node, const char* key, std::int64_t min,
                          std::int64_t max, const std::string& place) const;

  const toml::table& table_;
  std::string file_;
  std::string path_;
};

}  // namespace forcegrid::text
