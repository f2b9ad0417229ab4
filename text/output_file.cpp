// SPDX-License-Identifier: Apache-2.0
#include "text/output_file.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <vector>

namespace forcegrid::text {
namespace {

namespace fs = std::filesystem;

struct Marked {
  std::mutex mutex;
  std::vector<std::string> files;
};

// Never destroyed: a watchdog may use it while the program ends.
Marked& marked() {
  static Marked& all = *new Marked;
  return all;
}

std::string target_of(const std::string& file) {
  std::error_code error;
  if (!fs::is_symlink(file, error)) {
    return file;
  }
  const fs::path target = fs::weakly_canonical(file, error);
  return error ? file : target.string();
}

// In `target`'s folder, since a rename must not cross file systems.
std::string partial_of(const std::string& target) {
  std::error_code error;
  const bool direct = fs::exists(target, error) && !fs::is_regular_file(target, error);
  return direct ? target : target + ".partial-" + std::to_string(::getpid());
}

}  // namespace

UnfinishedFile::UnfinishedFile(std::string file) : file_(std::move(file)) {
  const std::lock_guard lock(marked().mutex);
  marked().files.push_back(file_);
}

UnfinishedFile::~UnfinishedFile() {
  const std::lock_guard lock(marked().mutex);
  auto& files = marked().files;
  const auto mine = std::find(files.begin(), files.end(), file_);
  if (mine != files.end()) {
    files.erase(mine);
  }
}

void remove_unfinished_files() noexcept {
  Marked& all = marked();
  all.mutex.lock();  // for good: nothing is marked any more
  for (const std::string& file : all.files) {
    std::error_code error;
    if (fs::is_regular_file(file, error)) {
      fs::remove(file, error);
    }
  }
}

OutputFile::OutputFile(const std::string& file)
    : name_(file), target_(target_of(file)), partial_(partial_of(target_)), mark_(partial_) {
  errno = 0;
  stream_.open(partial_);
  if (!stream_) {
    fail();
  }
}

OutputFile::~OutputFile() {
  if (!finished_ && partial_ != target_) {
    std::remove(partial_.c_str());
  }
}

void OutputFile::finish() {
  errno = 0;
  stream_.close();
  if (!stream_ || (partial_ != target_ && std::rename(partial_.c_str(), target_.c_str()) != 0)) {
    fail();
  }
  finished_ = true;
}

void OutputFile::fail() const {
  throw std::runtime_error(name_ + " can't be written (" +
                           (errno != 0 ? std::strerror(errno) : "writing failed") +
                           "); free some space, or name a file in a folder that is writable");
}

}  // namespace forcegrid::text
