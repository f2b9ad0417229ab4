// SPDX-License-Identifier: Apache-2.0
#include "log/log.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/version.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <vector>

#include "log/repeats.h"
#include "rt/clock.h"

namespace forcegrid::log {
namespace {

using NoMutex = spdlog::details::null_mutex;  // Log's own comes first
using Take = std::function<void(const std::string&)>;

constexpr std::size_t kMostHeld = 1000;
constexpr std::chrono::milliseconds kLastWait{100};

spdlog::level::level_enum spdlog_level(Level level) {
  return static_cast<spdlog::level::level_enum>(
      level == Level::kOff ? static_cast<int>(spdlog::level::off) : static_cast<int>(level));
}
static_assert(static_cast<int>(Level::kError) == static_cast<int>(spdlog::level::err));

bool is_set(const char* variable) {
  const char* const value = std::getenv(variable);
  return value != nullptr && *value != '\0';
}

// Colour is for people at a terminal who do not object (https://no-color.org).
bool wants_colour(int descriptor) {
  const char* const terminal = std::getenv("TERM");
  return isatty(descriptor) == 1 && !is_set("NO_COLOR") &&
         !(terminal != nullptr && std::strcmp(terminal, "dumb") == 0);
}

// A whole line at once: other processes write to the same terminal.
void write_all(int descriptor, const std::string& text) {
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t count = ::write(descriptor, text.data() + done, text.size() - done);
    if (count < 0 && errno != EINTR) {
      return;  // nobody is left to tell
    }
    done += count > 0 ? static_cast<std::size_t>(count) : 0;
  }
}

// Writes the message that Log points it to in a form of ours.
class Form : public spdlog::formatter {
 public:
  Form(const Message* const& message, std::function<std::string(const Message&)> line)
      : message_(message), line_(std::move(line)) {}

  void format(const spdlog::details::log_msg& /*text*/, spdlog::memory_buf_t& out) override {
    const std::string line = line_(*message_) + "\n";
    out.append(line.data(), line.data() + line.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<Form>(message_, line_);
  }

 private:
  const Message* const& message_;
  std::function<std::string(const Message&)> line_;
};

// Standard error and output, or whoever draws on the terminal.
class ConsoleSink : public spdlog::sinks::base_sink<NoMutex> {
 public:
  ConsoleSink(const Message* const& message, const std::vector<const Take*>& takers, bool json)
      : message_(message), takers_(takers), json_(json) {}

 private:
  void sink_it_(const spdlog::details::log_msg& /*text*/) override {
    if (message_->where == Where::kFileOnly) {
      return;
    }
    const bool on_stdout = message_->where == Where::kStdout && !json_;
    const bool coloured = on_stdout ? colour_of_stdout_ : colour_of_stderr_;
    const std::string line =
        json_ ? json_line(*message_) : console_line(*message_, coloured && takers_.empty());
    if (!takers_.empty()) {
      (*takers_.back())(line);
    } else if (on_stdout) {  // in order with what is printed there by other means
      std::fputs((line + "\n").c_str(), stdout);
      std::fflush(stdout);
    } else {
      write_all(STDERR_FILENO, line + "\n");
    }
  }
  void flush_() override {}

  const Message* const& message_;
  const std::vector<const Take*>& takers_;
  const bool json_;
  const bool colour_of_stdout_ = wants_colour(STDOUT_FILENO);
  const bool colour_of_stderr_ = wants_colour(STDERR_FILENO);
};

// Of std::exception::what() in spdlog: "Failed writing to file run.log: No space left on device".
std::string reason_in(const std::string& what) {
  const std::size_t colon = what.rfind(": ");
  return colon == std::string::npos ? what : what.substr(colon + 2);
}

std::runtime_error not_writable(const std::string& file, const std::string& reason) {
  return std::runtime_error("log file " + file + " can't be written (" + reason +
                            "); name a file in a folder that exists, on a disk with space");
}

Message with_time(Message message) {
  using std::chrono::nanoseconds;
  if (message.servo_time_ns == 0) {
    message.servo_time_ns = nanoseconds(rt::Clock::now().time_since_epoch()).count();
  }
  if (message.utc_ns == 0) {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    message.utc_ns = std::chrono::duration_cast<nanoseconds>(now).count();
  }
  return message;
}

// The one log of the process.
class Log {
 public:
  Log() { set_up({}); }

  void hold() {
    const std::lock_guard lock(mutex_);
    holding_ = true;
  }

  void start(const Options& options) {
    const std::lock_guard lock(mutex_);
    set_up(options);
    if (!options.file.empty()) {
      open(options);
    }
    release();
  }

  void finish() {
    const std::lock_guard lock(mutex_);
    end();
  }

  void write(Message message) {
    const std::lock_guard lock(mutex_);
    take(std::move(message));
  }

  bool last_words(Message message) {
    const std::unique_lock lock(mutex_, kLastWait);
    if (lock) {
      take(std::move(message));
      end();
    }
    return lock.owns_lock();
  }

  void add_taker(const Take& take) {
    const std::lock_guard lock(mutex_);
    takers_.push_back(&take);
  }

  void remove_taker(const Take& take) {
    const std::lock_guard lock(mutex_);
    std::erase(takers_, &take);
  }

  Level console_level() const { return console_level_; }
  Level file_level() const { return file_level_; }
  bool json() const { return json_; }

 private:
  // The console alone.
  void set_up(const Options& options) {
    json_ = options.json;
    console_level_ = options.quiet ? std::max(options.level, Level::kError) : options.level;
    file_level_ = Level::kOff;
    auto console = std::make_shared<ConsoleSink>(message_, takers_, options.json);
    console->set_level(spdlog_level(console_level_));
    logger_ = std::make_unique<spdlog::logger>("forcegrid", std::move(console));
    logger_->set_level(spdlog::level::trace);  // each sink has its own
    logger_->set_error_handler([this](const std::string& what) { file_trouble_ = what; });
  }

  // The first line shows whether the disk has space.
  void open(const Options& options) {
    std::error_code ignored;
    const std::filesystem::path folder = std::filesystem::path(options.file).parent_path();
    if (!folder.empty() && !std::filesystem::is_directory(folder, ignored)) {
      throw not_writable(options.file, "there is no folder " + folder.string());
    }
    try {
      const auto file = std::make_shared<spdlog::sinks::rotating_file_sink<NoMutex>>(
          options.file, options.largest_file_bytes, options.older_files);
      file->set_formatter(std::make_unique<Form>(message_, options.json ? json_line : file_line));
      const Message first = with_time({Level::kInfo, "log", options.first_line});
      message_ = &first;
      file->log(spdlog::details::log_msg("", spdlog::level::info, ""));
      message_ = nullptr;
      file->flush();
      file->set_level(spdlog_level(options.level));
      logger_->sinks().push_back(file);
      logger_->flush_on(spdlog::level::trace);  // so that a killed process has said it all
    } catch (const spdlog::spdlog_ex& error) {
      throw not_writable(options.file, reason_in(error.what()));
    }
    file_ = options.file;
    file_level_ = options.level;
  }

  void take(Message message) {
    if (holding_ && held_.size() < kMostHeld) {
      held_.push_back(with_time(std::move(message)));
      return;
    }
    const Level console = message.where == Where::kFileOnly ? Level::kOff : console_level_.load();
    if (message.level < std::min(console, file_level_.load())) {
      return;
    }
    for (const Message& one : repeats_.take(with_time(std::move(message)))) {
      say(one);
    }
  }

  void release() {
    holding_ = false;
    for (Message& message : std::exchange(held_, {})) {
      take(std::move(message));
    }
  }

  void end() {
    release();
    for (const Message& count : repeats_.end()) {
      say(count);
    }
  }

  void say(const Message& message) {
    message_ = &message;
    logger_->log(spdlog_level(message.level), spdlog::string_view_t());
    message_ = nullptr;
    if (!file_trouble_.empty()) {
      give_up_file();
    }
  }

  void give_up_file() {
    const std::string reason = reason_in(std::exchange(file_trouble_, {}));
    if (logger_->sinks().size() < 2) {
      return;
    }
    logger_->sinks().pop_back();
    file_level_ = Level::kOff;
    say(with_time({Level::kError, "log",
                   "log file " + file_ + " ends here: " + reason +
                       "; later messages are on standard error alone. Free some space for the "
                       "next time"}));
  }

  std::timed_mutex mutex_;
  std::atomic<Level> console_level_{Level::kInfo};
  std::atomic<Level> file_level_{Level::kOff};
  std::atomic<bool> json_{false};
  bool holding_ = false;
  std::vector<Message> held_;
  Repeats repeats_;
  const Message* message_ = nullptr;  // for the sinks
  std::vector<const Take*> takers_;
  std::unique_ptr<spdlog::logger> logger_;
  std::string file_;
  std::string file_trouble_;  // what a sink has just thrown
};

// It outlives everything that may say something.
Log& the_log() {
  static Log* const log = new Log();
  return *log;
}

}  // namespace

void hold() { the_log().hold(); }
void start(const Options& options) { the_log().start(options); }
void finish() { the_log().finish(); }
void write(Message message) { the_log().write(std::move(message)); }

void debug(const std::string& component, const std::string& text) {
  write({Level::kDebug, component, text});
}
void info(const std::string& component, const std::string& text) {
  write({Level::kInfo, component, text});
}
void warn(const std::string& component, const std::string& text) {
  write({Level::kWarn, component, text});
}
void error(const std::string& component, const std::string& text) {
  write({Level::kError, component, text});
}

void last_words(const std::string& component, const std::string& text) noexcept {
  try {
    const Message message = with_time({Level::kError, component, text});
    if (!the_log().last_words(message) && console_shows(Level::kError)) {
      const bool json = console_is_json();
      write_all(STDERR_FILENO, (json ? json_line(message) : console_line(message, false)) + "\n");
    }
  } catch (...) {  // no memory: the exit status remains
  }
}

bool console_shows(Level level) {
  return level != Level::kOff && level >= the_log().console_level();
}

std::string library_version() {
  return std::to_string(SPDLOG_VER_MAJOR) + "." + std::to_string(SPDLOG_VER_MINOR) + "." +
         std::to_string(SPDLOG_VER_PATCH);
}

bool console_is_json() { return the_log().json(); }

Level least_level() { return std::min(the_log().console_level(), the_log().file_level()); }

ConsoleTaker::ConsoleTaker(Take take) : take_(std::move(take)) { the_log().add_taker(take_); }
ConsoleTaker::~ConsoleTaker() { the_log().remove_taker(take_); }

}  // namespace forcegrid::log
