// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::testing {

/// This project's command with `arguments`; no configuration file counts but one that they name,
/// and a run, recording or calibration waits longer for its device than the usual 100 ms, for which
/// a machine that is shared may well stand still.
std::vector<std::string> forcegrid_command(std::vector<std::string> arguments);

/// A program started by a test, its output kept in files, ended when the test ends.
class Program {
 public:
  /// @param command the program and its arguments.
  explicit Program(const std::vector<std::string>& command);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// forcegrid_command() of these.
  static Program forcegrid(std::vector<std::string> arguments);

  void send_signal(int number) const;
  pid_t pid() const noexcept { return pid_; }
  /// Waits for its end. @returns its exit status, 128 + signal, or nothing after `timeout`.
  std::optional<int> wait(std::chrono::milliseconds timeout = std::chrono::seconds(60));
  std::string standard_output() const;
  std::string standard_error() const;
  /// The first line of its standard output that begins with `prefix`, waiting for it.
  std::string wait_for_line(const std::string& prefix,
                            std::chrono::milliseconds timeout = std::chrono::seconds(20)) const;
  /// Waits until its output (either stream) contains `text`. @returns whether it came.
  bool wait_for_text(const std::string& text,
                     std::chrono::milliseconds timeout = std::chrono::seconds(20)) const;

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
  std::string out_file_, err_file_;
};

/// A file's bytes; empty where there is no such file.
std::string text_of(const std::string& file);

/// A folder of its own under the test's temporary folder, empty.
std::string fresh_folder(const std::string& name);

}  // namespace forcegrid::testing
