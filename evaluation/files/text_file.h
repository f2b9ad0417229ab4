// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>

namespace forcegrid::evaluation {

/// A file can't be read or written. `what()` names the file, the system's reason and the remedy.
class FileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Reads the lines of a text file, which is gzipped if and only if its name ends in .gz.
/// Real-time: no. Threads: one.
class LineReader {
 public:
  /// @throws FileError.
  explicit LineReader(const std::string& file);
  ~LineReader();
  LineReader(const LineReader&) = delete;
  LineReader& operator=(const LineReader&) = delete;

  /// Reads the next line without its end (\n or \r\n); valid until the next call.
  /// @returns false after the last one.
  /// @throws FileError if reading fails, if the file is truncated or damaged, if its name and its
  ///         content disagree on gzip, or if a line is longer than 64 kB.
  bool next(std::string_view& line);

  /// Number of the line that next() returned last; the first is 1.
  std::size_t line_number() const noexcept { return line_number_; }

 private:
  bool refill();

  struct Stream;
  std::unique_ptr<Stream> stream_;
  std::size_t line_number_ = 0;
};

/// Writes a text file, gzipped if its name ends in .gz. The file appears under its name, and
/// replaces an older one, only after finish() has written all of it to disk.
/// Real-time: no. Threads: one.
class TextWriter {
 public:
  /// @throws FileError, also if the name belongs to something other than a regular file.
  explicit TextWriter(const std::string& file);
  /// Without finish(): removes the partial file.
  ~TextWriter();
  TextWriter(const TextWriter&) = delete;
  TextWriter& operator=(const TextWriter&) = delete;

  /// @throws FileError, e.g. for a full disk.
  void write(std::string_view text);

  /// @throws FileError, e.g. for a full disk; the file then does not appear.
  void finish();

 private:
  struct Stream;
  std::unique_ptr<Stream> stream_;
};

/// Appends the shortest text that reads back as exactly `value`.
void append_number(std::string& text, double value);

}  // namespace forcegrid::evaluation
