// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_support.h"

#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "evaluation/charts/row_file.h"
#include "evaluation/objects/force_table.h"

namespace forcegrid::cli {
namespace {

namespace fs = std::filesystem;

}  // namespace

std::filesystem::path cache_folder(const std::string& asked) {
  if (!asked.empty()) {
    return asked;
  }
  const char* const cache = std::getenv("XDG_CACHE_HOME");
  if (cache != nullptr && fs::path(cache).is_absolute()) {
    return fs::path(cache) / "forcegrid";
  }
  const char* const home = std::getenv("HOME");
  if (home != nullptr && fs::path(home).is_absolute()) {
    return fs::path(home) / ".cache" / "forcegrid";
  }
  throw std::runtime_error(
      "neither XDG_CACHE_HOME nor HOME names a folder for the force tables; give one with --cache");
}

std::string program_hash() {
  const char* const self = "/proc/self/exe";
  std::ifstream file(self, std::ios::binary);
  evaluation::ContentHash hash;
  std::vector<char> block(1 << 20);
  while (file.read(block.data(), static_cast<std::streamsize>(block.size())), file.gcount() > 0) {
    hash.add(block.data(), static_cast<std::size_t>(file.gcount()));
  }
  if (file.bad() || !file.eof()) {
    throw std::runtime_error(std::string(self) +
                             " can't be read; is /proc mounted? It tells rows of different "
                             "programs apart");
  }
  return hash.text();
}

void add_chart_choice(Command& command, ChartChoice& choice, const ChartFlagWords& words) {
  command.add_option("--out", choice.out, "Folder for tables, pictures and the page")->required();
  command.add_flag("--quick", choice.quick, words.quick);
  command.add_option("--jobs", choice.jobs, std::string(words.jobs) + "; 0 is one per processor")
      ->check(whole_between(0, 1024))
      ->type_name("UINT threads")
      ->show_default();
  command.add_option(
      "--cache", choice.cache,
      std::string("Folder of ") + words.cached + " (default forcegrid in the user's cache folder)");
  command.add_option("--seed", choice.seed, words.seed)->check(seed_number())->show_default();
}

void add_sharded_choice(Command& command, ShardedChoice& choice, const ChartFlagWords& words) {
  add_chart_choice(command, choice, words);
  Option* const shard =
      command
          .add_option("--shard", choice.shard,
                      "Make only part I of N of the rows, e.g. 2/8, without pictures; --merge puts "
                      "the parts together")
          ->check({[](const std::string& text) {
                     try {
                       static_cast<void>(evaluation::parse_shard(text));
                       return std::string();
                     } catch (const std::invalid_argument& error) {
                       return std::string(error.what());
                     }
                   },
                   "I/N"})
          ->not_in_config();
  command
      .add_option(
          "--merge", choice.merge,
          "Folders of shards, whose rows count as made; what is in none of them is made now")
      ->type_name("DIR ...")
      ->excludes(shard)
      ->not_in_config();
}

void merge_shards(const ShardedChoice& choice, const std::string& program, ProgressLine& line) {
  if (!choice.merge.empty()) {
    const std::size_t added =
        evaluation::merge_rows(choice.out, program, {choice.merge.begin(), choice.merge.end()});
    line.say("merged " + std::to_string(added) + " rows of " + std::to_string(choice.merge.size()) +
             " shards");
  }
}

int end_of_shard(const ShardedChoice& choice, std::size_t rows, std::size_t not_judged,
                 double elapsed_s, ProgressLine& line) {
  line.clear();
  std::printf(
      "Shard %s: %zu rows in %s in %s, %zu not judged; put the shards together with --merge\n",
      choice.shard.c_str(), rows, choice.out.c_str(), time_text(elapsed_s).c_str(), not_judged);
  return 0;
}

bool GoalCount::add(bool known, bool met) {
  (known ? known_ : unknown_) += 1;
  met_ += known && met ? 1 : 0;
  return known;
}

std::string GoalCount::sentence() const {
  if (known_ == 0) {
    return "No goal is in this selection";
  }
  std::string text = std::to_string(met_) + " of " + std::to_string(known_) + " goals met";
  if (unknown_ > 0) {
    text += "; " + std::to_string(unknown_) + " are not in this selection";
  }
  return text;
}

void add_goals_for(Command& command, std::string& method) {
  command.add_option("--goals-for", method,
                     "Method that is held against the goals (default: that of 'run')");
}

}  // namespace forcegrid::cli
