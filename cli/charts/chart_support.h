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

/// What every chart is asked for; the commands' own options derive from it.
struct ChartChoice {
  std::string out;
  std::string cache;  ///< folder of force tables; empty: forcegrid in the user's cache folder
  bool quick = false;
  unsigned jobs = 0;  ///< 0: one thread per processor
  std::uint64_t seed = 1;
};

/// The words of the flags that differ from chart to chart.
struct ChartFlagWords {
  const char* quick;
  const char* jobs = "Threads";
  const char* cached = "force tables";
  const char* seed;
};

/// Adds --out, --quick, --jobs, --cache and --seed.
void add_chart_choice(CLI::App& command, ChartChoice& choice, const ChartFlagWords& words);

/// Adds --goals-for: the method that is held against the chart's goals.
void add_goals_for(CLI::App& command, std::string& method);

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
  ProgressLine() = default;
  /// Clears the line, so that what an exception makes the program say begins on a line of its own.
  ~ProgressLine() { clear(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

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

/// Takes over what is asked of every chart, and has `line` show how far it is.
/// @throws std::runtime_error when there is no folder for force tables.
template <typename Options>
void take_choice(Options& options, const ChartChoice& choice, ProgressLine& line) {
  prepare_folder(choice.out);  // found out before minutes of work are lost
  options.out = choice.out;
  options.cache = cache_folder(choice.cache);
  options.jobs = choice.jobs;
  options.seed = choice.seed;
  options.cancel = &StopRequest::stop();
  options.say = line.say_function();
  options.progress = line.show_function();
}

/// take_choice(), and what the charts of force methods share.
/// @throws std::runtime_error as that, or when /proc is not mounted.
template <typename Options, typename Asked>
void take_common(Options& options, const Asked& asked, ProgressLine& line) {
  take_choice(options, asked, line);
  options.methods = asked.methods;
  options.quick = asked.quick;
  options.default_method = asked.goals_for.empty() ? std::string(kDefaultMethod) : asked.goals_for;
  options.program = program_hash();
}

}  // namespace forcegrid::cli
