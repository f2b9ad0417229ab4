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

/// Lines of a text file, which is gzipped if and only if its name ends in .gz.
/// Real-time: no. Threads: one.
class LineReader {
 public:
  /// @throws FileError.
  explicit LineReader(const std::string& file);
  ~LineReader();
  LineReader(const LineReader&) = delete;
  LineReader& operator=(const LineReader&) = delete;

  /// The next line without its end (\n or \r\n); valid until the next call.
  /// @returns false after the last one.
  /// @throws FileError when reading fails, the file is cut off or damaged, not gzipped although its
  ///         name says so (or the reverse), or has a line of more than 64 kB.
  bool next(std::string_view& line);

  /// Of the line that next() gave last; the first is 1.
  std::size_t line_number() const noexcept { return line_number_; }

 private:
  bool refill();

  struct Stream;
  std::unique_ptr<Stream> stream_;
  std::size_t line_number_ = 0;
};

/// Writes a text file, gzipped if its name ends in .gz. Nothing exists under the file's name, or
/// what was there before stays, until finish() has put all of it on the disk.
/// Real-time: no. Threads: one.
class TextWriter {
 public:
  /// @throws FileError, also when the name belongs to something that is no plain file.
  explicit TextWriter(const std::string& file);
  /// Without finish(): removes what was written.
  ~TextWriter();
  TextWriter(const TextWriter&) = delete;
  TextWriter& operator=(const TextWriter&) = delete;

  /// @throws FileError, e.g. for a full disk.
  void write(std::string_view text);

  /// @throws FileError, e.g. for a full disk; then the file has not appeared.
  void finish();

 private:
  struct Stream;
  std::unique_ptr<Stream> stream_;
};

/// Appends the shortest text that reads back as exactly `value`.
void append_number(std::string& text, double value);

}  // namespace forcegrid::evaluation
