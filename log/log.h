// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "log/message.h"

namespace forcegrid::log {

/// Everything that a person may want to see or hide. One log per process, on the console and, if
/// asked, in a file that spdlog rotates. Until start() messages of level info and above go to the
/// console as text.
///
/// Real-time: none of this. The servo thread pushes records into the telemetry ring, and the thread
/// that drains it says what they mean; servo_loop/, driver/, forcegrid/ and rt/ may not include
/// log/ (tests/readme/rooms_test.py). Threads: any.

struct Options {
  Level level = Level::kInfo;  ///< the least that is shown, on the console and in the file
  bool quiet = false;          ///< on the console errors only
  bool json = false;           ///< JSON lines instead of text, on stderr and in the file
  std::string file{};          ///< empty: none
  std::string first_line{};    ///< begins the file, whatever the level
  std::size_t largest_file_bytes = 10'000'000;
  std::size_t older_files = 3;  ///< "run.log" is renamed to "run.1.log", and so on
};

/// Holds messages back until start() or finish(), because it is not known yet who may see them.
void hold();

/// Sets it up; call it before other threads say anything.
/// @throws std::runtime_error that names the file, the system's reason and a remedy if the file
///         can't be written. Messages then go to the console alone.
void start(const Options& options);

/// Says what is held back and counted. Later messages are still said.
void finish();

void write(Message message);
void debug(const std::string& component, const std::string& text);
void info(const std::string& component, const std::string& text);
void warn(const std::string& component, const std::string& text);
void error(const std::string& component, const std::string& text);

/// As error() and finish(), for a process about to end whose other threads may be stuck: waits at
/// most a tenth of a second for them.
void last_words(const std::string& component, const std::string& text) noexcept;

/// Version of spdlog that this was compiled with.
std::string library_version();

/// Whether messages of this level appear on the console.
bool console_shows(Level level);
/// The console gets JSON lines.
bool console_is_json();
/// The least level that appears anywhere.
Level least_level();

/// Takes the console's lines, without their newline, while it lives: for whoever draws on the
/// terminal. `take` must not say anything itself. The newest one that lives takes them.
class ConsoleTaker {
 public:
  explicit ConsoleTaker(std::function<void(const std::string& line)> take);
  ~ConsoleTaker();
  ConsoleTaker(const ConsoleTaker&) = delete;
  ConsoleTaker& operator=(const ConsoleTaker&) = delete;

 private:
  std::function<void(const std::string&)> take_;
};

}  // namespace forcegrid::log
