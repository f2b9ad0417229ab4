// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fstream>
#include <string>

namespace forcegrid::text {

/// Marks a file as unfinished while it lives: remove_unfinished_files() deletes it.
/// Threads: any.
class UnfinishedFile {
 public:
  /// @param file is written from now on; it need not exist yet.
  explicit UnfinishedFile(std::string file);
  ~UnfinishedFile();
  UnfinishedFile(const UnfinishedFile&) = delete;
  UnfinishedFile& operator=(const UnfinishedFile&) = delete;

 private:
  std::string file_;
};

/// Deletes every file that an UnfinishedFile of this process marks, for a process that ends at
/// once. Afterwards no other file can be marked: a thread that tries waits for ever.
void remove_unfinished_files() noexcept;

/// A text file that appears under its name, and replaces an older one, only when finish() has
/// written all of it. Until then it is FILE.partial-PID beside it. What is not a regular file, as
/// /dev/stdout, is written directly.
/// Real-time: no. Threads: one.
class OutputFile {
 public:
  /// @throws std::runtime_error with the file's name and the system's reason.
  explicit OutputFile(const std::string& file);
  /// Without finish(): removes the partial file.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  [[nodiscard]] std::ostream& stream() noexcept { return stream_; }
  /// @throws std::runtime_error, e.g. for a full disk; the file then keeps its old content.
  void finish();

 private:
  [[noreturn]] void fail() const;

  std::string name_;     ///< as asked for, for messages
  std::string target_;   ///< where a symbolic link leads
  std::string partial_;  ///< equals `target_` for what is written directly
  UnfinishedFile mark_;
  std::ofstream stream_;
  bool finished_ = false;
};

}  // namespace forcegrid::text
