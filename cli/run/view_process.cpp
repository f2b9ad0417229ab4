// SPDX-License-Identifier: Apache-2.0
#include "cli/run/view_process.h"

#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>

#include <array>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

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

// "listening ADDR:PORT folder FOLDER token TOKEN", and with TLS "certificate SHA256", word by word.
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

// "0.0.0.0:80" is no address to go to: this machine's name stands there instead.
std::string address_to_open(const std::string& listening) {
  const std::size_t colon = listening.rfind(':');
  const std::string address = listening.substr(0, colon);
  if (colon == std::string::npos || (address != "0.0.0.0" && address != "[::]")) {
    return listening;
  }
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) {
    throw std::runtime_error(std::string("--view: cannot learn this machine's name: ") +
                             std::strerror(errno));
  }
  return name.data() + listening.substr(colon);
}

// "AB:CD:..." of "abcd...", as browsers show it.
std::string with_colons(const std::string& digits) {
  std::string text;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && i % 2 == 0) {
      text += ':';
    }
    text += static_cast<char>(std::toupper(static_cast<unsigned char>(digits[i])));
  }
  return text;
}

std::vector<std::string> arguments_of(const std::string& listen, const std::string& key_file) {
  std::vector<std::string> arguments = {"--listen", listen, "--until-stdin-closes"};
  if (!key_file.empty()) {
    arguments.insert(arguments.end(), {"--key", key_file});
  }
  return arguments;
}

}  // namespace

ViewProcess::ViewProcess(const std::string& listen, const std::string& key_file)
    : process_(arguments_of(listen, key_file),
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
  const auto certificate = facts.find("certificate");
  if (certificate != facts.end()) {
    certificate_sha256_ = certificate->second;
  }
  url_ = (certificate_sha256_.empty() ? "http://" : "https://") +
         address_to_open(facts.at("listening")) + "/?token=" + facts.at("token");
}

std::string ViewProcess::address_text() const {
  std::string text = "view: " + url_ + "\n";
  if (!certificate_sha256_.empty()) {
    text += "view: its certificate has the SHA-256 fingerprint " +
            with_colons(certificate_sha256_) + "\n";
  }
  return text;
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
