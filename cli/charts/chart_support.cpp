// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_support.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include "evaluation/force_table.h"

namespace forcegrid::cli {
namespace {

namespace fs = std::filesystem;
using std::chrono::steady_clock;

constexpr std::chrono::milliseconds kTerminalPeriod{200};
constexpr std::chrono::seconds kLogPeriod{10};

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

std::string time_text(double time_s) {
  const long seconds = std::lround(time_s);
  char text[32];
  if (seconds < 60) {
    std::snprintf(text, sizeof text, "%ld s", seconds);
  } else {
    std::snprintf(text, sizeof text, "%ld min %02ld s", seconds / 60, seconds % 60);
  }
  return text;
}

bool ProgressLine::is_terminal() { return isatty(STDERR_FILENO) == 1; }

void ProgressLine::show(const std::string& what, double done, double remaining_s) {
  const auto now = steady_clock::now();
  if (now - shown_ <
      (terminal_ ? steady_clock::duration(kTerminalPeriod) : steady_clock::duration(kLogPeriod))) {
    return;
  }
  shown_ = now;
  std::fprintf(stderr, "%s%s: %3.0f %%, %s left%s", terminal_ ? "\r\033[K" : "", what.c_str(),
               100.0 * done, time_text(remaining_s).c_str(), terminal_ ? "" : "\n");
  open_ = terminal_;
}

void ProgressLine::say(const std::string& text) {
  clear();
  std::fprintf(stderr, "%s\n", text.c_str());
}

void ProgressLine::clear() {
  if (open_) {
    std::fputs("\r\033[K", stderr);
    open_ = false;
  }
}

std::function<void(const std::string&)> ProgressLine::say_function() {
  return [this](const std::string& text) { say(text); };
}

std::function<void(const std::string&, double, double)> ProgressLine::show_function() {
  return [this](const std::string& what, double done, double remaining_s) {
    show(what, done, remaining_s);
  };
}

void add_chart_choice(CLI::App& command, ChartChoice& choice, const ChartFlagWords& words) {
  command.add_option("--out", choice.out, "Folder for tables, pictures and the page")->required();
  command.add_flag("--quick", choice.quick, words.quick);
  command.add_option("--jobs", choice.jobs, std::string(words.jobs) + "; 0 is one per processor")
      ->check(CLI::Range(0, 1024))
      ->type_name("UINT threads")
      ->capture_default_str();
  command.add_option(
      "--cache", choice.cache,
      std::string("Folder of ") + words.cached + " (default forcegrid in the user's cache folder)");
  command.add_option("--seed", choice.seed, words.seed)->capture_default_str();
}

void add_goals_for(CLI::App& command, std::string& method) {
  command.add_option("--goals-for", method,
                     "Method that is held against the goals (default: that of 'run')");
}

}  // namespace forcegrid::cli
