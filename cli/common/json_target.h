#pragma once

#include <string>

namespace forcegrid::cli {

/// `--json [FILE]`: not wanted, on standard output, or into a file.
struct JsonTarget {
  bool wanted = false;
  std::string file;  ///< empty: standard output

  bool on_stdout() const { return wanted && file.empty(); }
};

/// Why `file` can't be written to, in the system's words; empty where it can. A file that exists
/// stays as it is, and none is left where there was none.
std::string why_not_writable(const std::string& file);

/// @throws std::runtime_error when the target is a file that can't be written, with the reason.
void check_writable(const JsonTarget& target);

/// Writes `text` and a newline where the target says, if wanted at all.
/// @throws std::runtime_error naming the file and the system's reason; the text is then on standard
///         output.
void write_json(const JsonTarget& target, const std::string& text);

}  // namespace forcegrid::cli
