// SPDX-License-Identifier: Apache-2.0
#include "tools/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "text/output_file.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const std::string& file, const std::string& what) {
  throw AtomicFileError(file + ": " + what +
                        "; make its folder writable, or name a file elsewhere");
}

class Descriptor {
 public:
  Descriptor(const std::string& file, int flags) : number_(::open(file.c_str(), flags, 0644)) {}
  ~Descriptor() {
    if (number_ >= 0) {
      ::close(number_);
    }
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  [[nodiscard]] int number() const noexcept { return number_; }

 private:
  int number_;
};

void write_to_disk(const std::string& file, std::string_view text) {
  const Descriptor descriptor(file, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC);
  if (descriptor.number() < 0) {
    fail(file, std::strerror(errno));
  }
  while (!text.empty()) {
    const ssize_t written = ::write(descriptor.number(), text.data(), text.size());
    if (written < 0 && errno == EINTR) {
      continue;
    }
    if (written < 0) {
      fail(file, std::strerror(errno));
    }
    text.remove_prefix(static_cast<std::size_t>(written));
  }
  if (::fsync(descriptor.number()) != 0) {
    fail(file, std::strerror(errno));
  }
}

// Syncs the folder, so that the new name is on the disk, too.
void sync_folder(const std::string& folder) {
  const Descriptor descriptor(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor.number() < 0 || ::fsync(descriptor.number()) != 0) {
    fail(folder, std::strerror(errno));
  }
}

// A second name for the old content, so that the file itself never disappears.
void keep_old(const std::string& file) {
  std::error_code error;
  if (!fs::exists(file, error)) {
    return;
  }
  const std::string old = file + ".old";
  fs::remove(old, error);
  fs::create_hard_link(file, old, error);
  if (error) {
    fs::copy_file(file, old, fs::copy_options::overwrite_existing, error);
  }
  if (error) {
    fail(old, error.message());
  }
}

}  // namespace

void replace_file(const std::string& file, const std::string& text,
                  const std::function<void(const std::string& written)>& check) {
  const std::string parent = fs::path(file).parent_path().string();
  const std::string folder = parent.empty() ? "." : parent;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) {
    fail(folder, error.message());
  }
  // With a folder in the name, lookups treat it as a path.
  const std::string fresh = folder + "/." + fs::path(file).filename().string() + "." +
                            std::to_string(::getpid()) + ".new";
  const forcegrid::text::UnfinishedFile unfinished(fresh);
  try {
    write_to_disk(fresh, text);
    if (check) {
      check(fresh);
    }
    keep_old(file);
    fs::rename(fresh, file, error);
    if (error) {
      fail(file, error.message());
    }
  } catch (...) {
    fs::remove(fresh, error);
    throw;
  }
  sync_folder(folder);
}

}  // namespace forcegrid::tools
