#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "cli/common/stop_request.h"
#include "cli/run/run_checks.h"
#include "forcegrid/methods.h"

namespace forcegrid::cli {

/// What the subcommands of `chart` share.

/// The folder for force tables: `asked`, or if that is empty one in the user's cache folder.
/// @throws std::runtime_error when the environment names none.
std::filesystem::path cache_folder(const std::string& asked);

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
  /// The first two as functions, which it must outlive.
  std::function<void(const std::string&)> say_function();
  std::function<void(const std::string&, double, double)> show_function();

 private:
  bool terminal_ = is_terminal();
  bool open_ = false;
  std::chrono::steady_clock::time_point shown_{};

  static bool is_terminal();
};

/// What all charts take from the command line, and how they tell `line` what they do.
/// @throws std::runtime_error when there is no folder for force tables, or /proc is not mounted.
template <typename ChartOptions, typename Asked>
void take_common(ChartOptions& options, const Asked& asked, ProgressLine& line) {
  prepare_folder(asked.out);  // found out before minutes of work are lost
  options.out = asked.out;
  options.cache = cache_folder(asked.cache);
  options.methods = asked.methods;
  options.quick = asked.quick;
  options.jobs = asked.jobs;
  options.seed = asked.seed;
  options.default_method = asked.goals_for.empty() ? std::string(kDefaultMethod) : asked.goals_for;
  options.program = program_hash();
  options.cancel = &StopRequest::stop();
  options.say = line.say_function();
  options.progress = line.show_function();
}

}  // namespace forcegrid::cli
