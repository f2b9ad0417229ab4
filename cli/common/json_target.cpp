// SPDX-License-Identifier: Apache-2.0
#include "cli/common/json_target.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <system_error>

namespace forcegrid::cli {

std::string why_not_writable(const std::string& file) {
  std::error_code error;
  const bool was_there = std::filesystem::exists(file, error);
  errno = 0;
  if (!std::ofstream(file, std::ios::app)) {
    return std::strerror(errno);
  }
  if (!was_there) {
    std::filesystem::remove(file, error);
  }
  return "";
}

void check_writable(const JsonTarget& target) {
  const std::string why_not = target.file.empty() ? "" : why_not_writable(target.file);
  if (!why_not.empty()) {
    throw std::runtime_error("--json " + target.file + " can't be written (" + why_not +
                             "); name a file in a folder that exists");
  }
}

void write_json(const JsonTarget& target, const std::string& text) {
  if (!target.wanted) {
    return;
  }
  if (target.file.empty()) {
    std::printf("%s\n", text.c_str());
    if (std::fflush(stdout) != 0) {
      throw std::runtime_error(std::string("standard output: ") + std::strerror(errno));
    }
    return;
  }
  errno = 0;
  std::ofstream file(target.file);
  file << text << '\n';
  file.close();
  if (!file) {
    const std::string reason = std::strerror(errno);
    std::printf("%s\n", text.c_str());  // so that it is not lost
    throw std::runtime_error("--json " + target.file + ": " + reason +
                             "; the summary is on standard output instead");
  }
}

}  // namespace forcegrid::cli
