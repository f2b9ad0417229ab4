// SPDX-License-Identifier: Apache-2.0
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string_view>

#include "cli/common/log_options.h"
#include "cli/common/tools_names.h"
#include "cli/tools_program.h"
#include "log/log.h"

namespace forcegrid::cli {
namespace {

namespace fs = std::filesystem;

// What the command line asks of forcegrid-tools.
struct Asked {
  std::string what;             // "chart", "simulate --bench"; empty: nothing
  bool can_do_without = false;  // `forcegrid` knows less of it, but something
};

Asked asked(int argc, const char* const* argv) {
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--config" || is_log_option_with_value(word)) {
      ++i;
    } else if (word == "--help-all" || word == "config") {
      return {word, true};
    } else if (word == "simulate") {
      const bool bench = std::any_of(
          argv + i, argv + argc, [](std::string_view argument) { return argument == "--bench"; });
      return {bench ? "simulate --bench" : "", false};
    } else if (!word.starts_with('-')) {
      return {is_tools_command(word) ? word : "", false};
    }
  }
  return {};
}

// The source folder that a build folder was made for; empty: it is none.
fs::path source_folder(const fs::path& build_folder) {
  std::ifstream cache(build_folder / "CMakeCache.txt");
  const std::string key = "CMAKE_HOME_DIRECTORY:INTERNAL=";
  for (std::string line; std::getline(cache, line);) {
    if (line.starts_with(key)) {
      return line.substr(key.size());
    }
  }
  return {};
}

// Calls make, whose output goes to standard error. @returns whether it succeeded.
bool make_tools(const fs::path& source) {
  std::array<std::string, 4> words = {"make", "-C", source.string(), "tools"};
  std::array<char*, 5> argv{};
  std::transform(words.begin(), words.end(), argv.begin(),
                 [](std::string& word) { return word.data(); });
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
  pid_t pid = -1;
  const int error = posix_spawnp(&pid, "make", &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) {
    log::error("tools", std::string("make can't be started: ") + std::strerror(error));
    return false;
  }
  int status = 0;
  while (waitpid(pid, &status, 0) == -1 && errno == EINTR) {
  }
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

// forcegrid-tools is not beside this program: builds it if this is the build folder of `make`.
// @returns whether it is there now; if not, why has been said.
bool provide(const fs::path& program, const std::string& what) {
  const fs::path build_folder = program.parent_path().parent_path();
  const fs::path source = source_folder(build_folder);
  if (source.empty()) {
    log::error("tools", "'" + what + "' is in the program forcegrid-tools, and there is no " +
                            program.string() + "; install the package forcegrid-tools");
    return false;
  }
  if (build_folder != source / "build" / "release") {
    log::error("tools", "'" + what +
                            "' is in the program forcegrid-tools, which is not built; build it: "
                            "cmake -DFORCEGRID_BUILD_TOOLS=ON " +
                            build_folder.string() + " && cmake --build " + build_folder.string());
    return false;
  }
  log::info("tools", "'" + what +
                         "' is in the program forcegrid-tools, which is not built yet; building it "
                         "takes some minutes: make -C " +
                         source.string() + " tools");
  if (!make_tools(source)) {
    log::error("tools", "forcegrid-tools could not be built; the reason is above");
    return false;
  }
  return true;
}

}  // namespace

bool has_tools_commands() { return false; }

std::shared_ptr<void> add_tools_commands(Command& program, std::function<int()>& /*action*/) {
  for (const ToolsCommand& command : tools_commands()) {
    program.add_subcommand(command.name, command.description);
  }
  return nullptr;
}

std::optional<int> become_tools_program(int argc, char** argv) {
  const Asked wanted = asked(argc, argv);
  if (wanted.what.empty()) {
    return std::nullopt;
  }
  std::error_code unknown;
  const fs::path self = fs::read_symlink("/proc/self/exe", unknown);
  const fs::path program = self.parent_path() / "forcegrid-tools";
  if (!fs::exists(program, unknown)) {
    if (wanted.can_do_without) {
      return std::nullopt;
    }
    if (!provide(program, wanted.what)) {
      return 1;
    }
  }
  execv(program.c_str(), argv);
  log::error("tools", program.string() + " can't be started: " + std::strerror(errno));
  return 1;
}

int bench_command(const std::string& /*scene*/, const JsonTarget& /*json*/) {
  throw std::logic_error("simulate --bench is a command of forcegrid-tools");
}

}  // namespace forcegrid::cli
