// SPDX-License-Identifier: Apache-2.0
#include "evaluation/files/gnuplot.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <list>
#include <system_error>
#include <thread>

#include "evaluation/files/error.h"
#include "rt/checkpoint.h"
#include "text/output_file.h"

namespace forcegrid::evaluation {
namespace {

// The exit status of a child that can't become gnuplot, as a shell's.
constexpr int kNotFound = 127;

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
  const char* const end = file.extension() == ".png"   ? "IEND"
                          : file.extension() == ".pdf" ? "%%EOF"
                                                       : "</svg>";
  return stream && tail.find(end) != std::string::npos;
}

class Script {
 public:
  explicit Script(const std::string& text) : descriptor_(::memfd_create("gnuplot", MFD_CLOEXEC)) {
    std::size_t done = 0;
    while (descriptor_ >= 0 && done < text.size()) {
      const ssize_t written = ::write(descriptor_, text.data() + done, text.size() - done);
      if (written < 0 && errno != EINTR) {
        break;
      }
      done += static_cast<std::size_t>(std::max<ssize_t>(written, 0));
    }
    if (descriptor_ < 0 || done < text.size() || ::lseek(descriptor_, 0, SEEK_SET) != 0) {
      throw ChartError(std::string("gnuplot could not be started: ") + std::strerror(errno));
    }
  }
  ~Script() { ::close(descriptor_); }
  Script(const Script&) = delete;
  Script& operator=(const Script&) = delete;

  [[nodiscard]] int descriptor() const { return descriptor_; }

 private:
  int descriptor_;
};

// As waitpid() gives it. Ctrl-C in the terminal does not reach gnuplot; it ends with this program.
int status_of_gnuplot(const std::string& script) {
  constexpr std::chrono::milliseconds kLook{5};
  const Script input(script);
  const pid_t pid = ::fork();
  if (pid == 0) {
    // Only calls that are safe between fork and exec.
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::signal(SIGINT, SIG_IGN);
    const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
    ::dup2(input.descriptor(), STDIN_FILENO);
    ::dup2(nowhere, STDOUT_FILENO);
    ::execlp("gnuplot", "gnuplot", static_cast<char*>(nullptr));
    ::_exit(kNotFound);
  }
  if (pid < 0) {
    throw ChartError(std::string("gnuplot could not be started: ") + std::strerror(errno));
  }
  int status = 0;
  try {
    while (::waitpid(pid, &status, WNOHANG) == 0) {
      rt::checkpoint();
      std::this_thread::sleep_for(kLook);
    }
  } catch (...) {
    ::kill(pid, SIGKILL);
    ::waitpid(pid, &status, 0);
    throw;
  }
  return status;
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
  std::list<text::UnfinishedFile> unfinished;
  for (const std::filesystem::path& file : files) {
    unfinished.emplace_back(file.string());
  }
  int status = 0;
  try {
    status = status_of_gnuplot(script);
  } catch (const rt::Interrupted&) {
    std::error_code ignored;
    for (const std::filesystem::path& file : files) {
      if (std::filesystem::is_regular_file(file, ignored)) {
        std::filesystem::remove(file, ignored);
      }
    }
    throw;
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNotFound) {
    throw NoGnuplot("there is no gnuplot to draw " + files.front().string() +
                    "; install the package gnuplot-nox; the data are in the same folder");
  }
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
