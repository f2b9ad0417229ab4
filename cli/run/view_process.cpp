// SPDX-License-Identifier: Apache-2.0
#include "cli/run/view_process.h"

#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <map>
#include <sstream>
#include <stdexcept>

#include "text/own_prefix.h"

namespace forcegrid::cli {
namespace {

constexpr char kProgram[] = "forcegrid-view";

std::string path_of_view() {
  const std::filesystem::path path =
      std::filesystem::path(text::own_file()).parent_path() / kProgram;
  if (::access(path.c_str(), X_OK) != 0) {
    throw std::runtime_error("--view: " + path.string() + ": " + std::strerror(errno) +
                             "; install the package forcegrid-view, or build it with 'make view'");
  }
  return path.string();
}

// "listening ADDR:PORT folder FOLDER token TOKEN", word by word.
std::map<std::string, std::string> facts_of(const std::string& line) {
  std::istringstream words(line);
  std::map<std::string, std::string> facts;
  for (std::string key, value; words >> key >> value;) {
    facts[key] = value;
  }
  for (const char* const key : {"listening", "folder", "token"}) {
    if (facts[key].empty()) {
      throw std::runtime_error("--view: forcegrid-view says '" + line + "' without its " + key +
                               "; is it of another version?");
    }
  }
  return facts;
}

}  // namespace

ViewProcess::ViewProcess(const std::string& listen)
    : process_({"--listen", listen, "--until-stdin-closes"},
               ChildOptions{.name = "view", .program = path_of_view()}) {
  read_facts();
}

ViewProcess::ViewProcess(const std::string& export_file, double largest_MB)
    : process_({"--export", export_file, "--export-MB", std::to_string(largest_MB),
                "--until-stdin-closes"},
               ChildOptions{.name = "view", .program = path_of_view()}) {
  read_facts();
}

std::optional<std::string> ViewProcess::exported(std::chrono::milliseconds timeout) {
  const bool was_running = process_.running();
  std::optional<std::string> line = process_.read_line(timeout);
  if (!line && !was_running) {
    throw std::runtime_error("--export: forcegrid-view " + process_.abnormal_end() +
                             " and wrote no file; its reason is above");
  }
  return line;
}

void ViewProcess::read_facts() {
  const auto facts = facts_of(process_.wait_until_started());
  folder_ = facts.at("folder");
  url_ = "http://" + facts.at("listening") + "/?token=" + facts.at("token");
}

std::string ViewProcess::open_browser() const {
  std::string program = "xdg-open";
  std::string url = url_;
  char* const argv[] = {program.data(), url.data(), nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  for (const int descriptor : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    posix_spawn_file_actions_addopen(&actions, descriptor, "/dev/null", O_RDWR, 0);
  }
  pid_t pid = -1;
  const int error = ::posix_spawnp(&pid, program.c_str(), &actions, nullptr, argv, environ);
  posix_spawn_file_actions_destroy(&actions);
  return error == 0 ? "" : std::string("xdg-open: ") + std::strerror(error);
}

}  // namespace forcegrid::cli
