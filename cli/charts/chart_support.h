// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "cli/common/stop_request.h"
#include "cli/run/run_checks.h"
#include "forcegrid/methods.h"

namespace CLI {
class App;
}

namespace forcegrid::cli {

/// Options that every chart has; the options of each command derive from it.
struct ChartChoice {
  std::string out;
  std::string cache;  ///< folder of force tables; empty: forcegrid in the user's cache folder
  bool quick = false;
  unsigned jobs = 0;  ///< 0: one thread per processor
  std::uint64_t seed = 1;
};

/// Help texts of the flags that differ from chart to chart.
struct ChartFlagWords {
  const char* quick;
  const char* jobs = "Threads";
  const char* cached = "force tables";
  const char* seed;
};

/// Adds --out, --quick, --jobs, --cache and --seed.
void add_chart_choice(CLI::App& command, ChartChoice& choice, const ChartFlagWords& words);

/// Adds --goals-for: the method that is compared with the chart's goals.
void add_goals_for(CLI::App& command, std::string& method);

/// Returns the folder for force tables: `asked`, or if that is empty one in the user's cache
/// folder.
/// @throws std::runtime_error if neither XDG_CACHE_HOME nor HOME names a folder.
std::filesystem::path cache_folder(const std::string& asked);

/// Identifies this program by a hash of its executable's bytes.
/// @throws std::runtime_error if the executable can't be read.
std::string program_hash();

/// Formats a duration [s] for people: "42 s", "3 min 05 s".
std::string time_text(double time_s);

/// Shows progress on standard error: one line that is overwritten on a terminal, otherwise a line
/// every ten seconds.
/// Threads: one at a time.
class ProgressLine {
 public:
  ProgressLine() = default;
  /// Clears the line, so that the message of an exception starts on a new line.
  ~ProgressLine() { clear(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  void show(const std::string& what, double done, double remaining_s);
  void say(const std::string& text);
  void clear();
  /// say() and show() as functions; this object must outlive them.
  std::function<void(const std::string&)> say_function();
  std::function<void(const std::string&, double, double)> show_function();

 private:
  bool terminal_ = is_terminal();
  bool open_ = false;
  std::chrono::steady_clock::time_point shown_{};

  static bool is_terminal();
};

/// Copies the options that all charts share, prepares the output folder, and makes `line` show the
/// progress.
/// @throws std::runtime_error if there is no folder for force tables, or the output folder can't be
///         written.
template <typename Options>
void take_choice(Options& options, const ChartChoice& choice, ProgressLine& line) {
  prepare_folder(choice.out);  // fails here rather than after minutes of work
  options.out = choice.out;
  options.cache = cache_folder(choice.cache);
  options.jobs = choice.jobs;
  options.seed = choice.seed;
  options.cancel = &StopRequest::stop();
  options.say = line.say_function();
  options.progress = line.show_function();
}

/// take_choice(), and the options that the charts of force methods share.
/// @throws std::runtime_error as take_choice(), or if /proc is not mounted.
template <typename Options, typename Asked>
void take_common(Options& options, const Asked& asked, ProgressLine& line) {
  take_choice(options, asked, line);
  options.methods = asked.methods;
  options.quick = asked.quick;
  options.default_method = asked.goals_for.empty() ? std::string(kDefaultMethod) : asked.goals_for;
  options.program = program_hash();
}

}  // namespace forcegrid::cli
