// SPDX-License-Identifier: Apache-2.0
#include "evaluation/gnuplot.h"

#include <sys/wait.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <system_error>

#include "evaluation/force_table.h"

namespace forcegrid::evaluation {
namespace {

[[noreturn]] void fail(const std::filesystem::path& file, const std::string& how) {
  throw ChartError("gnuplot could not draw " + file.string() + " (" + how +
                   "); install the package gnuplot-nox, free some space or choose another folder "
                   "with --out; the data are in the same folder");
}

// gnuplot does not report a full disk, so this checks the last bytes of a picture.
bool whole(const std::filesystem::path& file) {
  constexpr std::streamoff kTail_bytes = 32;
  std::ifstream stream(file, std::ios::binary);
  stream.seekg(-kTail_bytes, std::ios::end);
  std::string tail(static_cast<std::size_t>(kTail_bytes), '\0');
  stream.read(tail.data(), kTail_bytes);
  return stream && tail.find(file.extension() == ".png" ? "IEND" : "</svg>") != std::string::npos;
}

// False: the picture was incomplete and has been removed.
bool keep_if_whole(const std::filesystem::path& file) {
  if (whole(file)) {
    return true;
  }
  std::error_code ignored;
  if (std::filesystem::is_regular_file(file, ignored)) {
    std::filesystem::remove(file, ignored);
  }
  return false;
}

}  // namespace

std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char character : text) {
    result += character == '\'' ? std::string("''") : std::string(1, character);
  }
  return result + "'";
}

void run_gnuplot(const std::string& script, const std::vector<std::filesystem::path>& files) {
  errno = 0;
  std::FILE* gnuplot = popen("trap '' INT; exec gnuplot 2>&1 >/dev/null", "w");
  if (gnuplot == nullptr) {
    throw ChartError(std::string("gnuplot could not be started: ") + std::strerror(errno));
  }
  std::fwrite(script.data(), 1, script.size(), gnuplot);
  const int status = pclose(gnuplot);
  if (status != 0) {
    fail(files.front(),
         "status " + std::to_string(WIFEXITED(status) ? WEXITSTATUS(status) : status));
  }
  const std::filesystem::path* cut_off = nullptr;
  for (const std::filesystem::path& file : files) {
    cut_off = keep_if_whole(file) ? cut_off : &file;
  }
  if (cut_off != nullptr) {
    fail(*cut_off, "the file is incomplete");
  }
}

}  // namespace forcegrid::evaluation
