// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::cli {

/// Target of `--json [FILE]`: none, standard output, or a file.
struct JsonTarget {
  bool wanted = false;
  std::string file;  ///< empty: standard output

  bool on_stdout() const { return wanted && file.empty(); }
};

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
