// SPDX-License-Identifier: Apache-2.0
// --log-level, --log-file, --log-format and --quiet, as users give them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/in_terminal.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::Contains;
using testing::forcegrid_command;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::InTerminal;
using ::testing::Not;
using testing::Program;
using testing::text_of;

constexpr auto kTimeout = std::chrono::seconds(60);
constexpr char kLoopRuns[] = "The servo loop runs: its first cycle is over.";

// An environment variable for the programs that a test starts.
class Variable {
 public:
  Variable(const char* name, const std::string& value) : name_(name) {
    ::setenv(name, value.c_str(), 1);
  }
  ~Variable() { ::unsetenv(name_); }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;

 private:
  const char* name_;
};

std::string write(const std::string& file, const std::string& text) {
  std::ofstream(file) << text;
  return file;
}

std::vector<std::string> short_run(const std::string& folder, const std::vector<std::string>& more,
                                   const char* seconds = "0.5") {
  std::vector<std::string> words{"run",   "--scene",        "small", "--seconds",
                                 seconds, "--no-reference", "--out", folder};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

// Every line as JSON; a line that is none fails the test.
std::vector<json> json_lines(const std::string& text) {
  std::vector<json> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    lines.push_back(json::parse(line, nullptr, false));
    EXPECT_FALSE(lines.back().is_discarded()) << line;
  }
  return lines;
}

std::set<std::string> values_of(const std::vector<json>& lines, const char* key) {
  std::set<std::string> values;
  for (const json& line : lines) {
    values.insert(line.at(key).get<std::string>());
  }
  return values;
}

TEST(LogOptions, AreNotNeededForWhatPeopleAndScriptsRead) {
  Program run = Program::forcegrid(short_run(fresh_folder("log_default"), {}));
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  EXPECT_THAT(run.standard_error(),
              AllOf(HasSubstr(std::string(kLoopRuns) + "\n"), HasSubstr("[simulator] solver ")));
  EXPECT_THAT(run.standard_output(),
              AllOf(HasSubstr("Device: "), HasSubstr("\nSimulator: "), HasSubstr("cycles in")));
  EXPECT_THAT(run.standard_error() + run.standard_output(), Not(HasSubstr("\033")));
}

TEST(LogOptions, QuietLeavesErrorsAndResults) {
  const std::string folder = fresh_folder("log_quiet");
  Program run = Program::forcegrid(short_run(folder, {"--quiet"}));
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  EXPECT_EQ(run.standard_error(), "");
  EXPECT_THAT(run.standard_output(), AllOf(HasSubstr("cycles in"), Not(HasSubstr("Device: HID")),
                                           Not(HasSubstr("cycles/s"))));
  Program with_json = Program::forcegrid(short_run(folder, {"--quiet", "--json"}));
  ASSERT_EQ(with_json.wait(kTimeout), 0);
  EXPECT_EQ(with_json.standard_error(), "");
  EXPECT_EQ(json::parse(with_json.standard_output()).at("ended_by"), "time");
  // A child's reason passes through both processes.
  const std::string scene = write(folder + "/bad.toml", "[object]\nshape = 3\n");
  for (const bool off : {false, true}) {
    Program bad = Program::forcegrid(
        {"run", "--scene", scene, "--quiet", "--log-level", off ? "off" : "info", "--out", folder});
    EXPECT_EQ(bad.wait(kTimeout), 1);
    EXPECT_EQ(bad.standard_output(), "");
    if (off) {
      EXPECT_EQ(bad.standard_error(), "");
    } else {
      EXPECT_THAT(bad.standard_error(), AllOf(HasSubstr("forcegrid: "), HasSubstr("bad.toml")));
    }
  }
}

TEST(LogOptions, QuietStillSaysWhichFaultEndedARun) {
  Program run = Program::forcegrid(
      short_run(fresh_folder("log_fault"),
                {"--quiet", "--json", "--calibrated", "--fault", "connection-closed"}, "40"));
  EXPECT_EQ(run.wait(kTimeout), 1);
  EXPECT_THAT(run.standard_error(), HasSubstr("forcegrid: FAULT: "));
}

TEST(LogOptions, JsonLinesComeFromEveryProcessWithTheServosClock) {
  const std::string folder = fresh_folder("log_json");
  const auto now_ns = [] {
    return std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1);
  };
  const std::int64_t before_ns = now_ns();
  Program run = Program::forcegrid(
      short_run(folder, {"--log-format", "json", "--log-level", "debug", "--json"}));
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  EXPECT_EQ(json::parse(run.standard_output()).at("ended_by"), "time") << "JSON alone";
  const std::vector<json> lines = json_lines(run.standard_error());
  for (const json& line : lines) {
    EXPECT_GE(line.at("servo_time_ns"), before_ns);
    EXPECT_LE(line.at("servo_time_ns"), now_ns());
  }
  EXPECT_THAT(values_of(lines, "process"), AllOf(Contains(""), Contains("simulator")));
  EXPECT_THAT(values_of(lines, "level"), AllOf(Contains("debug"), Contains("info")));
  EXPECT_THAT(values_of(lines, "message"), Contains(kLoopRuns));
}

TEST(LogOptions, AFileGetsEverythingOfAllProcesses) {
  const std::string folder = fresh_folder("log_file");
  const std::string file = folder + "/run.log";
  Program run = Program::forcegrid(
      short_run(folder, {"--quiet", "--log-file", file, "--log-level", "debug"}));
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  EXPECT_EQ(run.standard_error(), "");
  EXPECT_THAT(text_of(file),
              AllOf(HasSubstr(" info  log: "), HasSubstr("run --scene small"),
                    HasSubstr(" debug start: process "), HasSubstr(" info  [simulator] solver: "),
                    HasSubstr(kLoopRuns), HasSubstr("cycles in")));
}

TEST(LogOptions, FlagsCountBeforeVariablesAndThoseBeforeFiles) {
  const std::string folder = fresh_folder("log_layers");
  const std::string config = write(folder + "/c.toml", "[log]\nlevel = \"error\"\nquiet = true\n");
  const auto key_of = [&](const std::string& name) {
    Program shown = Program::forcegrid({"config", name, "--json", "--config", config});
    EXPECT_EQ(shown.wait(kTimeout), 0) << shown.standard_error();
    return json::parse(shown.standard_output()).at("keys").at(0);
  };
  EXPECT_EQ(key_of("log.level").at("value"), "error");
  EXPECT_EQ(key_of("log.level").at("from"), "file");
  const Variable level("FORCEGRID_LOG_LEVEL", "warn");
  const Variable loud("FORCEGRID_QUIET", "0");
  EXPECT_EQ(key_of("log.level").at("value"), "warn");
  EXPECT_EQ(key_of("log.level").at("from"), "environment FORCEGRID_LOG_LEVEL");
  EXPECT_EQ(key_of("log.quiet").at("value"), false);
  // A note of level info shows what counts.
  const auto said = [&](std::vector<std::string> words) {
    words.insert(words.end(), {"simulate", "--scene", "small", "--friction", "0.5", "--listen",
                               "127.0.0.1:0", "--until-stdin-closes", "--config", config});
    Program simulate = Program::forcegrid(words);
    EXPECT_EQ(simulate.wait(kTimeout), 0);
    return simulate.standard_error();
  };
  EXPECT_EQ(said({}), "");
  EXPECT_THAT(said({"--log-level", "info"}), HasSubstr("Note: --friction"));
  const Variable none("FORCEGRID_LOG_LEVEL", "");
  EXPECT_EQ(key_of("log.level").at("value"), "error") << "an empty variable is none";
}

TEST(LogOptions, AWrongValueIsAnErrorThatNamesWhereItCameFrom) {
  const std::string folder = fresh_folder("log_wrong");
  const auto refused = [](const std::vector<std::string>& words) {
    Program program = Program::forcegrid(words);
    EXPECT_EQ(program.wait(kTimeout), 2);
    return program.standard_error();
  };
  EXPECT_THAT(refused({"devices", "--log-level", "loud"}),
              AllOf(HasSubstr("--log-level"), HasSubstr("loud"), HasSubstr("warn")));
  EXPECT_THAT(refused({"devices", "--log-format", "xml"}),
              AllOf(HasSubstr("--log-format"), HasSubstr("xml")));
  const std::string config = write(folder + "/c.toml", "[log]\n\nformat = \"xml\"\n");
  EXPECT_THAT(refused({"devices", "--config", config}),
              AllOf(HasSubstr("c.toml:3"), HasSubstr("log.format"), HasSubstr("json")));
  for (const char* name : {"FORCEGRID_LOG_LEVEL", "FORCEGRID_LOG_FORMAT", "FORCEGRID_QUIET"}) {
    const Variable wrong(name, "perhaps");
    EXPECT_THAT(refused({"devices"}), HasSubstr(std::string(name) + "=perhaps: "));
  }
}

TEST(LogOptions, AFileThatCantBeWrittenIsAnErrorThatNamesWhereItCameFrom) {
  const std::string folder = fresh_folder("log_not_writable");
  const auto refused = [](const std::vector<std::string>& words) {
    Program program = Program::forcegrid(words);
    EXPECT_EQ(program.wait(kTimeout), 1);
    EXPECT_EQ(program.standard_output(), "") << "nothing was begun";
    return program.standard_error();
  };
  EXPECT_THAT(refused({"scene", "small", "--log-file", folder + "/no/x.log"}),
              AllOf(HasSubstr("forcegrid: --log-file: "), HasSubstr(folder + "/no/x.log"),
                    HasSubstr("name a file in a folder that exists")));
  const std::string config = write(folder + "/c.toml", "[log]\nfile = \"/dev/full\"\n");
  EXPECT_THAT(refused({"scene", "small", "--config", config}),
              AllOf(HasSubstr("c.toml:2"), HasSubstr("No space left on device")));
  const Variable variable("FORCEGRID_LOG_FILE", folder);
  EXPECT_THAT(refused({"scene", "small"}),
              AllOf(HasSubstr("FORCEGRID_LOG_FILE"), HasSubstr("Is a directory")));
}

TEST(LogOptions, MayStandBeforeACommandOfForcegridTools) {
  Program plot = Program::forcegrid(
      {"--log-level", "error", "--log-format", "text", "plot", "/no-such-file.h5"});
  EXPECT_EQ(plot.wait(kTimeout), 1);
  EXPECT_THAT(plot.standard_error(), HasSubstr("/no-such-file.h5"));
}

TEST(LogOptions, OnATerminalTheMarkOfAnErrorIsRedUnlessColourIsNotWanted) {
  const std::vector<std::string> command = forcegrid_command({"scene", "/tmp"});
  const Variable terminal("TERM", "xterm");
  InTerminal coloured(command);
  EXPECT_TRUE(coloured.wait_for("\033[1;31mforcegrid: \033[0m"));
  const Variable no_colour("NO_COLOR", "1");
  InTerminal plain(command);
  EXPECT_TRUE(plain.wait_for("forcegrid: "));
  EXPECT_THAT(plain.seen(), Not(HasSubstr("\033[1;31m")));
}

TEST(LogOptions, ProgressIsAMessage) {
  Program quiet = Program::forcegrid({"doctor", "--seconds", "4", "--quiet"});
  ASSERT_TRUE(quiet.wait(kTimeout).has_value());
  EXPECT_EQ(quiet.standard_error(), "");
  EXPECT_THAT(quiet.standard_output(), HasSubstr("wake-up idle"));
  // Also on a terminal no line is rewritten between JSON lines.
  InTerminal lines(forcegrid_command({"doctor", "--seconds", "4", "--log-format", "json"}));
  EXPECT_TRUE(lines.wait_for("\"component\":\"progress\""));
  EXPECT_THAT(lines.seen(), Not(HasSubstr("\033[K")));
}

}  // namespace
}  // namespace forcegrid
