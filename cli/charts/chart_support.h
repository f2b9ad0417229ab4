// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/stop_request.h"
#include "cli/common/stop_watchdog.h"
#include "cli/run/run_checks.h"
#include "evaluation/charts/shard.h"
#include "evaluation/objects/force_table.h"
#include "forcegrid/methods.h"
#include "rt/checkpoint.h"

namespace forcegrid::cli {

/// Options that every chart has; the options of each command derive from it.
struct ChartChoice {
  std::string out;
  std::string cache;  ///< folder of force tables; empty: forcegrid in the user's cache folder
  bool quick = false;
  unsigned jobs = 0;  ///< 0: one thread per processor
  std::uint64_t seed = 1;
};

/// A chart that several processes may share.
struct ShardedChoice : ChartChoice {
  std::string shard;               ///< "2/8"; empty: all of it
  std::vector<std::string> merge;  ///< folders of shards
};

/// Help texts of the flags that differ from chart to chart.
struct ChartFlagWords {
  const char* quick;
  const char* jobs = "Threads";
  const char* cached = "force tables";
  const char* seed;
};

/// Adds --out, --quick, --jobs, --cache and --seed.
void add_chart_choice(Command& command, ChartChoice& choice, const ChartFlagWords& words);

/// add_chart_choice(), --shard and --merge.
void add_sharded_choice(Command& command, ShardedChoice& choice, const ChartFlagWords& words);

/// Puts the rows of the shards that are to be merged into the output folder.
/// @throws std::runtime_error as evaluation::merge_rows().
void merge_shards(const ShardedChoice& choice, const std::string& program, ProgressLine& line);

/// Says what a shard has made and what comes next. @returns the exit status, 0.
int end_of_shard(const ShardedChoice& choice, std::size_t rows, std::size_t not_judged,
                 double elapsed_s, ProgressLine& line);

/// Prints the line above a chart's goals, unless the selection contains none of them.
template <typename Number>
void print_goals_head(const std::vector<Number>& numbers, const std::string& of_what) {
  for (const Number& each : numbers) {
    if (each.known()) {
      std::printf("Goals, %s:\n", of_what.c_str());
      return;
    }
  }
}

/// Counts the goals of a chart for the sentence below them.
class GoalCount {
 public:
  /// @returns `known`: whether the goal has a line.
  bool add(bool known, bool met);
  /// "16 of 20 goals met; 17 are not in this selection", or that there are none.
  std::string sentence() const;

 private:
  int known_ = 0;
  int met_ = 0;
  int unknown_ = 0;
};

/// Adds --goals-for: the method that is compared with the chart's goals.
void add_goals_for(Command& command, std::string& method);

/// Returns the folder for force tables: `asked`, or if that is empty one in the user's cache
/// folder.
/// @throws std::runtime_error if neither XDG_CACHE_HOME nor HOME names a folder.
std::filesystem::path cache_folder(const std::string& asked);

/// Identifies this program by a hash of its executable's bytes.
/// @throws std::runtime_error if the executable can't be read.
std::string program_hash();

/// Runs `work`, which keeps what it has finished; a stop says so, whoever carries it out.
/// @throws what it throws; evaluation::Stopped, which says how to go on, instead of
/// rt::Interrupted.
template <typename Work>
auto resumable(const Work& work) {
  const StoppedText text(evaluation::Stopped().what());
  try {
    return work();
  } catch (const rt::Interrupted&) {
    throw evaluation::Stopped();
  }
}

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
  options.shard = asked.shard.empty() ? evaluation::Shard{} : evaluation::parse_shard(asked.shard);
  merge_shards(asked, options.program, line);
}

}  // namespace forcegrid::cli
