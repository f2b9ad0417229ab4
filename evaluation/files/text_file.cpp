// SPDX-License-Identifier: Apache-2.0
#include "evaluation/files/text_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <optional>
#include <vector>

#include "text/output_file.h"

namespace forcegrid::evaluation {
namespace {

constexpr std::size_t kChunk = 1U << 16;

bool named_gz(const std::string& file) {
  return file.size() >= 3 && file.compare(file.size() - 3, 3, ".gz") == 0;
}

[[noreturn]] void fail(const std::string& file, const std::string& what) {
  throw FileError(file + ": " + what);
}

// zlib's words, or the system's when zlib passes on a failed call.
std::string reason_of(gzFile gz, int system_error) {
  int code = Z_OK;
  const char* const text = gzerror(gz, &code);
  return code == Z_ERRNO ? std::strerror(system_error) : text;
}

}  // namespace

struct LineReader::Stream {
  std::string file;
  gzFile gz = nullptr;
  std::vector<char> text = std::vector<char>(2 * kChunk);
  std::size_t begin = 0;  ///< of the text not returned yet
  std::size_t end = 0;
  bool at_end = false;

  ~Stream() {
    if (gz != nullptr) {
      gzclose(gz);
    }
  }
};

LineReader::LineReader(const std::string& file) : stream_(std::make_unique<Stream>()) {
  stream_->file = file;
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) {
    fail(file, "is a folder, not a file");
  }
  errno = 0;
  stream_->gz = gzopen(file.c_str(), "rb");
  if (stream_->gz == nullptr) {
    fail(file, std::string("can't be read (") +
                   (errno != 0 ? std::strerror(errno) : "not enough memory") + ")");
  }
}

LineReader::~LineReader() = default;

// Moves the remaining text to the front and reads more. False at the end of the file.
bool LineReader::refill() {
  Stream& s = *stream_;
  if (s.at_end) {
    return false;
  }
  std::memmove(s.text.data(), s.text.data() + s.begin, s.end - s.begin);
  s.end -= s.begin;
  s.begin = 0;
  if (s.end > kChunk) {
    fail(s.file, "line " + std::to_string(line_number_ + 1) +
                     " is longer than 64 kB, too long for a trace");
  }
  const bool first = gztell(s.gz) == 0;
  errno = 0;
  const int count = gzread(s.gz, s.text.data() + s.end, kChunk);
  const int system_error = errno;
  if (first && count >= 0) {
    if (named_gz(s.file) && gzdirect(s.gz) == 1) {
      fail(s.file, count == 0 ? "is empty" : "is not gzipped; remove .gz from its name");
    }
    if (!named_gz(s.file) && gzdirect(s.gz) == 0) {
      fail(s.file, "is gzipped; add .gz to its name");
    }
  }
  int code = Z_OK;
  gzerror(s.gz, &code);
  // Lines before the truncation are still returned, so that the message can name its place.
  if (count < 0 || (count == 0 && code != Z_OK && code != Z_STREAM_END)) {
    if (code == Z_BUF_ERROR) {
      fail(s.file, "ends in the middle of its gzip stream, after line " +
                       std::to_string(line_number_) + "; it is truncated, copy or record it again");
    }
    fail(s.file, "can't be read after line " + std::to_string(line_number_) + " (" +
                     reason_of(s.gz, system_error) + ")");
  }
  s.at_end = count == 0;
  s.end += static_cast<std::size_t>(count);
  return !s.at_end;
}

bool LineReader::next(std::string_view& line) {
  Stream& s = *stream_;
  std::size_t searched = 0;
  const char* newline = nullptr;
  for (;;) {
    const char* const from = s.text.data() + s.begin + searched;
    newline = static_cast<const char*>(std::memchr(from, '\n', s.end - s.begin - searched));
    if (newline != nullptr) {
      break;
    }
    searched = s.end - s.begin;
    if (!refill()) {
      break;
    }
  }
  const char* const first = s.text.data() + s.begin;
  if (newline == nullptr && s.begin == s.end) {
    return false;
  }
  const std::size_t length =
      newline != nullptr ? static_cast<std::size_t>(newline - first) : s.end - s.begin;
  s.begin += length + (newline != nullptr ? 1 : 0);
  line = std::string_view(first, length);
  if (!line.empty() && line.back() == '\r') {
    line.remove_suffix(1);
  }
  ++line_number_;
  return true;
}

struct TextWriter::Stream {
  std::string file;
  std::string partial;  ///< where it is written until it is complete
  std::optional<text::UnfinishedFile> mark;
  int descriptor = -1;
  gzFile gz = nullptr;

  ~Stream() {
    if (gz != nullptr) {
      gzclose(gz);
    }
    if (descriptor >= 0) {
      close(descriptor);
      unlink(partial.c_str());
    }
  }

  [[noreturn]] void fail_writing(const std::string& reason) const {
    fail(file, "can't be written (" + reason + "); no file was created under this name");
  }
};

TextWriter::TextWriter(const std::string& file) : stream_(std::make_unique<Stream>()) {
  Stream& s = *stream_;
  s.file = file;
  struct stat status {};
  if (stat(file.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
    fail(file, "exists and is not a regular file; choose another name");
  }
  s.partial = file + ".partial-" + std::to_string(getpid());
  s.mark.emplace(s.partial);
  s.descriptor = open(s.partial.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (s.descriptor < 0) {
    fail(file, std::string("can't be written (") + std::strerror(errno) +
                   "); name a file in a folder that exists and is writable");
  }
  const int copy = dup(s.descriptor);  // zlib closes its own
  s.gz = copy < 0 ? nullptr : gzdopen(copy, named_gz(file) ? "wb" : "wbT");
  if (s.gz == nullptr) {
    const std::string reason = copy < 0 ? std::strerror(errno) : "not enough memory";
    if (copy >= 0) {
      close(copy);
    }
    s.fail_writing(reason);
  }
}

TextWriter::~TextWriter() = default;

void TextWriter::write(std::string_view text) {
  Stream& s = *stream_;
  while (!text.empty()) {
    const std::string_view part = text.substr(0, kChunk);
    errno = 0;
    if (gzwrite(s.gz, part.data(), static_cast<unsigned>(part.size())) !=
        static_cast<int>(part.size())) {
      s.fail_writing(reason_of(s.gz, errno));
    }
    text.remove_prefix(part.size());
  }
}

void TextWriter::finish() {
  Stream& s = *stream_;
  errno = 0;
  const int closed = gzclose(s.gz);
  s.gz = nullptr;
  if (closed != Z_OK || fsync(s.descriptor) != 0 ||
      std::rename(s.partial.c_str(), s.file.c_str()) != 0) {
    s.fail_writing(errno != 0 ? std::strerror(errno) : "compression failed");
  }
  const int descriptor = s.descriptor;
  s.descriptor = -1;  // it has its final name, so the destructor must not remove it
  close(descriptor);
}

void append_number(std::string& text, double value) {
  char digits[32];
  const auto [end, error] = std::to_chars(digits, digits + sizeof digits, value);
  static_cast<void>(error);  // 32 characters hold any double
  text.append(digits, end);
}

}  // namespace forcegrid::evaluation
