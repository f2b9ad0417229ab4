#include "cli/json_target.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <stdexcept>

namespace forcegrid::cli {

void check_writable(const JsonTarget& target) {
  if (target.file.empty()) {
    return;
  }
  errno = 0;
  if (!std::ofstream(target.file, std::ios::app)) {
    throw std::runtime_error("--json " + target.file + " can't be written (" +
                             std::strerror(errno) + "); name a file in a folder that exists");
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
    std::printf("%s\n", text.c_str());  // rather here than lost
    throw std::runtime_error("--json " + target.file + ": " + reason +
                             "; the summary is on standard output instead");
  }
}

}  // namespace forcegrid::cli
