// SPDX-License-Identifier: Apache-2.0
#include "cli/exec_command.h"

#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string_view>

#include "log/log.h"
#include "text/own_prefix.h"

namespace forcegrid::cli {
namespace {

constexpr char kFolder[] = "lib/forcegrid/openhaptics";
constexpr char kLibrary[] = "libHD.so";
constexpr char kSearchPath[] = "LD_LIBRARY_PATH";
constexpr int kCannotRun = 126;
constexpr int kNoSuchProgram = 127;

std::string folder_of_libraries() {
  const std::filesystem::path folder = std::filesystem::path(text::own_prefix()) / kFolder;
  if (::access((folder / kLibrary).c_str(), R_OK) != 0) {
    throw std::runtime_error((folder / kLibrary).string() + ": " + std::strerror(errno) +
                             "; install libforcegrid-hd, or build it with 'make build'");
  }
  return folder.string();
}

}  // namespace

std::vector<std::string> take_command_of_exec(int& argc, const char* const* argv) {
  bool is_exec = false;
  for (int i = 1; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (word == "--" && is_exec) {
      std::vector<std::string> command(argv + i + 1, argv + argc);
      argc = i;
      return command;
    }
    is_exec = is_exec || word == "exec";
  }
  return {};
}

void add_exec(Command& app, ExecOptions& o, std::function<int()>& action) {
  Command& exec = app.add_subcommand(
      "exec",
      "Run a program for PHANTOM arms on a device of this project: forcegrid exec -- PROGRAM ARGS; "
      "see docs/openhaptics.md");
  exec.add_option("--device", o.device,
                  "emulated:PROFILE, or an attached device, as run --device takes it, or a name of "
                  "openhaptics.toml (default: FORCEGRID_DEVICE, else that file)")
      ->not_in_config();
  exec.footer("forcegrid exec --device emulated:woodenhaptics_v2015 -- PROGRAM ARGUMENTS...");
  exec.callback([&o, &action] {
    if (o.command.empty()) {
      throw OptionError("name the program behind --: forcegrid exec -- PROGRAM ARGUMENTS...");
    }
    action = [&o] { return exec_command(o); };
  });
}

int exec_command(const ExecOptions& options) {
  const char* const before = std::getenv(kSearchPath);
  std::string path = folder_of_libraries();
  if (before != nullptr && *before != '\0') {
    path.append(":").append(before);
  }
  ::setenv(kSearchPath, path.c_str(), 1);
  if (!options.device.empty()) {
    ::setenv("FORCEGRID_DEVICE", options.device.c_str(), 1);
  }
  std::vector<std::string> words = options.command;
  std::vector<char*> argv;
  for (std::string& word : words) {
    argv.push_back(word.data());
  }
  argv.push_back(nullptr);
  log::finish();
  std::signal(SIGPIPE, SIG_DFL);  // an ignored signal would stay ignored
  ::execvp(argv[0], argv.data());
  const int error = errno;
  log::error("exec", options.command.front() + ": " + std::strerror(error));
  return error == ENOENT ? kNoSuchProgram : kCannotRun;
}

}  // namespace forcegrid::cli
