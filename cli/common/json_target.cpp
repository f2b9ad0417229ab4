// SPDX-License-Identifier: Apache-2.0
#include "cli/common/json_target.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "log/log.h"
#include "text/output_file.h"

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

void say_result(const JsonTarget& target, const std::string& component, const std::string& text) {
  if (target.on_stdout()) {
    log::info(component, text);
    return;
  }
  std::printf("%s\n", text.c_str());
  std::fflush(stdout);
  log::write({log::Level::kInfo, component, text, "", log::Where::kFileOnly});
}

ResultText::ResultText(const JsonTarget& target, std::string component)
    : target_(target), component_(std::move(component)) {
  cookie_io_functions_t functions{};
  functions.write = [](void* self, const char* text, std::size_t size) {
    static_cast<ResultText*>(self)->take(text, size);
    return static_cast<ssize_t>(size);
  };
  stream_ = ::fopencookie(this, "w", functions);
  if (stream_ == nullptr) {
    throw std::runtime_error(std::string("no stream for results: ") + std::strerror(errno));
  }
  std::setvbuf(stream_, nullptr, _IOLBF, BUFSIZ);
}

ResultText::~ResultText() {
  std::fclose(stream_);
  if (!rest_.empty()) {
    say_result(target_, component_, rest_);
  }
}

void ResultText::take(const char* text, std::size_t size) {
  rest_.append(text, size);
  for (std::size_t end = rest_.find('\n'); end != std::string::npos; end = rest_.find('\n')) {
    say_result(target_, component_, rest_.substr(0, end));
    rest_.erase(0, end + 1);
  }
}

void say_step(const JsonTarget& target, const std::string& component, const std::string& text) {
  log::write({log::Level::kInfo, component, text, "",
              target.on_stdout() ? log::Where::kStderr : log::Where::kStdout});
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
  try {
    forcegrid::text::OutputFile file(target.file);
    file.stream() << text << '\n';
    file.finish();
  } catch (const std::runtime_error& error) {
    std::printf("%s\n", text.c_str());  // so that it is not lost
    throw std::runtime_error(std::string("--json ") + error.what() +
                             "; the summary is on standard output instead");
  }
}

}  // namespace forcegrid::cli
