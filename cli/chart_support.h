#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

namespace forcegrid::cli {

/// What the subcommands of `chart` share.

/// "a, b, c".
std::string joined(const std::vector<std::string>& words);

/// The folder for force tables in the user's cache folder.
/// @throws std::runtime_error when the environment names none.
std::filesystem::path default_cache();

/// What identifies this program: a hash of its own bytes.
/// @throws std::runtime_error when they can't be read.
std::string program_hash();

/// "42 s", "3 min 05 s".
std::string time_text(double time_s);

/// On a terminal one line that is written over and over, elsewhere a line every ten seconds.
/// Threads: one at a time.
class ProgressLine {
 public:
  void show(const std::string& what, double done, double remaining_s);
  void say(const std::string& text);
  void clear();

 private:
  bool terminal_ = is_terminal();
  bool open_ = false;
  std::chrono::steady_clock::time_point shown_{};

  static bool is_terminal();
};

}  // namespace forcegrid::cli
