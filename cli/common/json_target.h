// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdio>
#include <string>

namespace forcegrid::cli {

/// Target of `--json [FILE]`: none, standard output, or a file.
struct JsonTarget {
  bool wanted = false;
  std::string file;  ///< empty: standard output

  bool on_stdout() const { return wanted && file.empty(); }
};

/// Says a result in words: on standard output, and in the log's file at level info. If the JSON is
/// on standard output, it is a message of the log instead.
/// @param text  without a newline at its end.
void say_result(const JsonTarget& target, const std::string& component, const std::string& text);

/// A stream whose lines are said as by say_result(). Threads: one.
class ResultText {
 public:
  /// @param target  must outlive this.
  ResultText(const JsonTarget& target, std::string component);
  ~ResultText();
  ResultText(const ResultText&) = delete;
  ResultText& operator=(const ResultText&) = delete;

  std::FILE* stream() const { return stream_; }

 private:
  void take(const char* text, std::size_t size);

  const JsonTarget& target_;
  std::string component_;
  std::string rest_;  // of a line
  std::FILE* stream_;
};

/// A step on the way to a result, for people: a message of level info, on standard output where
/// the result is, too.
void say_step(const JsonTarget& target, const std::string& component, const std::string& text);

/// Returns the system's reason why `file` can't be written; empty if it can. The check neither
/// changes an existing file nor leaves a new one behind.
std::string why_not_writable(const std::string& file);

/// Checks that the target can be written. @throws std::runtime_error with the reason if it is a
/// file that can't be.
void check_writable(const JsonTarget& target);

/// Writes `text` and a newline to the target, if there is one.
/// @throws std::runtime_error naming the file and the system's reason; in that case `text` goes to
///         standard output.
void write_json(const JsonTarget& target, const std::string& text);

}  // namespace forcegrid::cli
