// SPDX-License-Identifier: Apache-2.0
#include "log/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace forcegrid::log {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::string> lines_of(const std::string& file) {
  std::ifstream stream(file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) {
    lines.push_back(line);
  }
  return lines;
}

/// The console's lines, in a vector. The process has one log; each test sets it up anew.
class Log : public ::testing::Test {
 public:
  ~Log() override {
    finish();
    start({});
    fs::remove_all(folder_);
  }

 protected:
  Log() : folder_(::testing::TempDir() + "/forcegrid_log_" + std::to_string(::getpid())) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    start({});
  }
  const std::string folder_;
  std::vector<std::string> console_;
  ConsoleTaker taker_{[this](const std::string& line) { console_.push_back(line); }};
};

void say_each_level() {
  write({Level::kTrace, "test", "t"});
  debug("test", "d");
  info("test", "i");
  warn("test", "w");
  error("test", "e");
}

TEST_F(Log, ShowsTheLevelAndAbove) {
  const std::vector<std::pair<Level, std::size_t>> shown = {{Level::kTrace, 5}, {Level::kDebug, 4},
                                                            {Level::kInfo, 3},  {Level::kWarn, 2},
                                                            {Level::kError, 1}, {Level::kOff, 0}};
  for (const auto& [level, count] : shown) {
    console_.clear();
    start({.level = level});
    say_each_level();
    EXPECT_EQ(console_.size(), count) << name_of(level);
    EXPECT_EQ(console_shows(Level::kInfo), level <= Level::kInfo);
    EXPECT_EQ(least_level(), level);
  }
}

TEST_F(Log, QuietHidesAllButErrorsFromTheConsoleAndNothingFromTheFile) {
  const std::string file = folder_ + "/run.log";
  start({.level = Level::kDebug, .quiet = true, .file = file, .first_line = "0.2.0: run"});
  say_each_level();
  EXPECT_THAT(console_, ElementsAre("forcegrid: e"));
  EXPECT_THAT(lines_of(file), ElementsAre(HasSubstr("info  log: 0.2.0: run"),
                                          HasSubstr("debug test: d"), HasSubstr("info  test: i"),
                                          HasSubstr("warn  test: w"), HasSubstr("error test: e")));
  console_.clear();
  start({.level = Level::kOff, .quiet = true});
  say_each_level();
  EXPECT_THAT(console_, IsEmpty()) << "quiet does not bring errors back";
}

TEST_F(Log, JsonLinesHaveBothClocks) {
  const std::string file = folder_ + "/run.jsonl";
  start({.json = true, .file = file, .first_line = "begins"});
  const auto before = std::chrono::steady_clock::now().time_since_epoch();
  info("test", "between");
  const auto after = std::chrono::steady_clock::now().time_since_epoch();
  ASSERT_EQ(console_.size(), 1U);
  EXPECT_EQ(lines_of(file).at(1), console_[0]) << "one form for both";
  const json line = json::parse(console_[0]);
  EXPECT_GE(line.at("servo_time_ns").get<std::int64_t>(), before / std::chrono::nanoseconds(1));
  EXPECT_LE(line.at("servo_time_ns").get<std::int64_t>(), after / std::chrono::nanoseconds(1));
  EXPECT_EQ(json::parse(lines_of(file).at(0)).at("message"), "begins");
}

TEST_F(Log, WhatIsForTheFileAloneStaysOffTheConsole) {
  const std::string file = folder_ + "/run.log";
  start({.file = file});
  write({Level::kError, "test", "in the file", "", Where::kFileOnly});
  EXPECT_THAT(console_, IsEmpty());
  EXPECT_THAT(lines_of(file).back(), HasSubstr("in the file"));
}

TEST_F(Log, HoldsBackUntilItIsKnownWhoMaySee) {
  hold();
  info("test", "early");
  EXPECT_THAT(console_, IsEmpty());
  start({});
  EXPECT_THAT(console_, ElementsAre("early"));
  hold();
  info("test", "hidden");
  start({.quiet = true});
  EXPECT_THAT(console_, ElementsAre("early"));
  hold();
  error("test", "never started");
  finish();
  EXPECT_THAT(console_, ElementsAre("early", "forcegrid: never started"));
}

TEST_F(Log, SaysRepeatsOnceWithACount) {
  for (int i = 0; i < 4; ++i) {
    write({Level::kInfo, "solver", "solver quasi_static", "run/simulator"});
    info("test", "try " + std::to_string(i));
  }
  finish();
  EXPECT_THAT(console_,
              ElementsAre("[run/simulator] solver quasi_static", "try 0", "try 1", "try 2", "try 3",
                          "[run/simulator] solver quasi_static (3 more times)"));
}

TEST_F(Log, RotatesTheFileAndKeepsSoManyOlderOnes) {
  start({.file = folder_ + "/run.log", .largest_file_bytes = 2000, .older_files = 2});
  for (int i = 0; i < 200; ++i) {
    info("test", "message number " + std::to_string(i));
  }
  EXPECT_TRUE(fs::exists(folder_ + "/run.1.log"));
  EXPECT_TRUE(fs::exists(folder_ + "/run.2.log"));
  EXPECT_FALSE(fs::exists(folder_ + "/run.3.log"));
  for (const auto& file : fs::directory_iterator(folder_)) {
    EXPECT_LE(file.file_size(), 2000U) << file.path();
  }
  EXPECT_THAT(lines_of(folder_ + "/run.log").back(), HasSubstr("message number 199"));
}

TEST_F(Log, AppendsToAFileThatIsThere) {
  const std::string file = folder_ + "/run.log";
  std::ofstream(file) << "mine\n";
  start({.file = file, .first_line = "begins"});
  EXPECT_THAT(lines_of(file), ElementsAre("mine", HasSubstr("begins")));
}

std::string why_not(const std::string& file) {
  try {
    start({.file = file});
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST_F(Log, AFileThatCantBeWrittenIsAnErrorAtTheStart) {
  EXPECT_THAT(why_not(folder_ + "/no/run.log"),
              AllOf(HasSubstr(folder_ + "/no/run.log"), HasSubstr("there is no folder"),
                    HasSubstr("name a file in a folder that exists")));
  EXPECT_THAT(why_not(folder_), HasSubstr("Is a directory"));
  EXPECT_THAT(why_not("/dev/full"), HasSubstr("/dev/full can't be written (No space left"));
  EXPECT_FALSE(fs::exists(folder_ + "/no")) << "no folder is made for a name mistyped";
  error("test", "still said");
  EXPECT_THAT(console_, ElementsAre("forcegrid: still said"));
}

// A limit of the file's size stands for a full disk.
TEST_F(Log, AFileThatCantBeWrittenAnyMoreIsSaidOnce) {
  const std::string file = folder_ + "/run.log";
  start({.file = file, .first_line = "begins"});
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{fs::file_size(file) + 10, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  info("test", "one that does not fit");
  info("test", "another");
  EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, ignored);
  info("test", "a third");
  EXPECT_THAT(console_,
              ElementsAre("one that does not fit",
                          AllOf(HasSubstr("forcegrid: log file " + file + " ends here: File too"),
                                HasSubstr("standard error alone")),
                          "another", "a third"));
}

TEST_F(Log, TakesMessagesFromManyThreads) {
  const std::string file = folder_ + "/run.jsonl";
  start({.json = true, .file = file});
  constexpr int kThreads = 4;
  constexpr int kEach = 250;
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([t] {
      for (int i = 0; i < kEach; ++i) {
        info("test", std::to_string(t) + " " + std::to_string(i));
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(console_.size(), static_cast<std::size_t>(kThreads * kEach));
  std::int64_t messages = 0;
  for (const std::string& line : lines_of(file)) {
    ASSERT_FALSE(json::parse(line, nullptr, false).is_discarded()) << line;
    ++messages;
  }
  EXPECT_EQ(messages, kThreads * kEach + 1);
}

TEST_F(Log, LastWordsDoNotWaitForAThreadThatIsStuck) {
  std::atomic<bool> stuck{false};
  std::atomic<bool> over{false};
  std::thread other;
  {
    const ConsoleTaker blocks([&](const std::string& line) {
      if (line == "stuck") {
        stuck = true;
        while (!over) {
          std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
      }
    });
    other = std::thread([] { info("test", "stuck"); });
    while (!stuck) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ::testing::internal::CaptureStderr();
    last_words("test", "stopped");
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "forcegrid: stopped\n");
    over = true;
    other.join();
  }
  last_words("test", "stopped again");
  EXPECT_THAT(console_, ElementsAre("forcegrid: stopped again"));
}

TEST_F(Log, TheNewestTakerThatLivesGetsTheConsole) {
  std::vector<std::string> inner;
  {
    const ConsoleTaker taker([&](const std::string& line) { inner.push_back(line); });
    info("test", "inner");
  }
  info("test", "outer");
  EXPECT_THAT(inner, ElementsAre("inner"));
  EXPECT_THAT(console_, ElementsAre("outer"));
}

}  // namespace
}  // namespace forcegrid::log
