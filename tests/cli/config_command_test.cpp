// SPDX-License-Identifier: Apache-2.0
// `forcegrid config` and what the files do to the other commands.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(20);

struct Said {
  int status = -1;
  std::string out;
  std::string err;
};

// With whatever files the environment leads to.
Said forcegrid(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), FORCEGRID_PROGRAM);
  Program program(arguments);
  Said said;
  said.status = program.wait(kTimeout).value_or(-1);
  said.out = program.standard_output();
  said.err = program.standard_error();
  return said;
}

std::string write(const std::string& file, const std::string& text) {
  std::filesystem::create_directories(std::filesystem::path(file).parent_path());
  std::ofstream(file) << text;
  return file;
}

json key_of(const std::vector<std::string>& arguments, const std::string& name) {
  std::vector<std::string> all{"config", "--json"};
  all.insert(all.end(), arguments.begin(), arguments.end());
  const Said said = forcegrid(all);
  EXPECT_EQ(said.status, 0) << said.err;
  const json shown = json::parse(said.out);
  for (const json& key : shown.at("keys")) {
    if (key.at("key") == name) {
      return key;
    }
  }
  ADD_FAILURE() << name << " is not shown";
  return {};
}

TEST(Config, LaterLayersOverrideEarlierAndFlagsOverrideAll) {
  const std::string folder = fresh_folder("layers");
  setenv("XDG_CONFIG_HOME", folder.c_str(), 1);
  const std::string user = write(folder + "/forcegrid/config.toml",
                                 "[run]\nrate = 300\nscene = \"small\"\nreconnect = true\n");
  const std::string asked = write(folder + "/mine.toml", "[run]\nrate = 400.5\n");

  EXPECT_EQ(key_of({"--no-config"}, "run.rate").at("value"), 500);
  EXPECT_EQ(key_of({"--no-config"}, "run.rate").at("from"), "built-in");
  EXPECT_EQ(key_of({}, "run.rate").at("value"), 300);
  EXPECT_EQ(key_of({}, "run.rate").at("from"), "user");
  EXPECT_EQ(key_of({}, "run.rate").at("file"), user);
  EXPECT_EQ(key_of({}, "run.rate").at("line"), 2);
  EXPECT_EQ(key_of({"--config", asked}, "run.rate").at("value"), 400.5);
  EXPECT_EQ(key_of({"--config", asked}, "run.rate").at("from"), "file");
  EXPECT_EQ(key_of({"--config", asked}, "run.scene").at("value"), "small");  // still the user's
  EXPECT_EQ(key_of({"--config", asked}, "run.reconnect").at("value"), true);
  // A flag is the last word: this rate is out of its range, the file's is not.
  const Said flag = forcegrid({"run", "--config", asked, "--rate", "99"});
  EXPECT_EQ(flag.status, 2);
  EXPECT_THAT(flag.err + flag.out, HasSubstr("'99'"));
  EXPECT_THAT(forcegrid({"run", "--config", asked, "--help"}).out, HasSubstr("=400.5"));
  unsetenv("XDG_CONFIG_HOME");
}

TEST(Config, IsWhatTheCommandThenDoes) {
  const std::string folder = fresh_folder("does");
  const std::string file =
      write(folder + "/c.toml",
            "[kinematics]\nprofile = \"woodenhaptics_v2015\"\n[run]\nscene = \"small\"\n");
  // Without the file, --profile is required.
  Program without = Program::forcegrid({"kinematics", "--counts", "1000,2000,6500"});
  EXPECT_EQ(without.wait(kTimeout), 2);
  Program with = Program::forcegrid({"kinematics", "--counts", "1000,2000,6500", "--config", file});
  ASSERT_EQ(with.wait(kTimeout), 0) << with.standard_error();
  Program flag = Program::forcegrid(
      {"kinematics", "--counts", "1000,2000,6500", "--profile", "vintage", "--config", file});
  ASSERT_EQ(flag.wait(kTimeout), 0) << flag.standard_error();
  EXPECT_NE(json::parse(with.standard_output()), json::parse(flag.standard_output()));
}

TEST(Config, ReadsADeprecatedKeyAndNamesTheNewOne) {
  const std::string file =
      write(fresh_folder("deprecated") + "/c.toml", "[run]\nshadow = [\"hold\"]\n");
  const Said said = forcegrid({"config", "run.evaluate", "--config", file});
  EXPECT_EQ(said.status, 0) << said.err;
  EXPECT_THAT(said.out, HasSubstr("evaluate = [\"hold\"]"));
  EXPECT_THAT(said.err, HasSubstr("c.toml:2: key 'run.shadow': deprecated"));
  EXPECT_THAT(said.err, HasSubstr("'run.evaluate'"));
}

struct Mistake {
  std::string text;
  std::vector<std::string> words;
};

TEST(Config, RefusesMistakesWithLineKeyAndRemedy) {
  const std::string folder = fresh_folder("mistakes");
  const std::vector<Mistake> mistakes = {
      {"[run]\nrtae = 500\n", {":2:", "'run.rtae'", "'run.rate'"}},
      {"[rum]\nscene = \"small\"\n", {":2:", "'rum.scene'", "'run.scene'"}},
      {"[run]\n\nrate = \"500\"\n", {":3:", "number in Hz", "100..4000"}},
      {"[run]\nrate = 99\n", {":2:", "100..4000"}},
      {"[run]\nrate = nan\n", {":2:", "100..4000"}},
      {"[run]\nfill-budget = 1.5\n", {":2:", "integer in vertices", "1..1000000"}},
      {"[run]\ncells = [1, 2]\n", {":2:", "run.cells"}},
      {"[run]\nevaluate = []\n", {":2:", "empty array"}},
      {"[run]\nreconnect = 1\n", {":2:", "true or false"}},
      {"[run]\nscene = \"blok\"\n", {":2:", "block"}},
      {"[run]\njson = true\n", {":2:", "unknown"}},  // a flag of one call, not a setting
      {"[run\n", {"c.toml"}}};
  for (const Mistake& mistake : mistakes) {
    Program program = Program::forcegrid(
        {"run", "--config", write(folder + "/c.toml", mistake.text), "--seconds", "1"});
    EXPECT_EQ(program.wait(kTimeout), 2) << mistake.text;
    for (const std::string& word : mistake.words) {
      EXPECT_THAT(program.standard_error(), HasSubstr(word)) << mistake.text;
    }
  }
  Program missing = Program::forcegrid({"run", "--config", folder + "/none.toml"});
  EXPECT_EQ(missing.wait(kTimeout), 2);
  EXPECT_THAT(missing.standard_error(), HasSubstr("none.toml"));
  Program unknown = Program::forcegrid({"config", "run.rtae"});
  EXPECT_EQ(unknown.wait(kTimeout), 2);
  EXPECT_THAT(unknown.standard_error(), HasSubstr("'run.rate'"));
}

TEST(Config, PrintsAFileThatItReads) {
  const std::string folder = fresh_folder("round");
  Program first = Program::forcegrid({"config"});
  ASSERT_EQ(first.wait(kTimeout), 0);
  const std::string file = write(folder + "/all.toml", first.standard_output());
  const json again = key_of({"--config", file}, "run.cells");
  EXPECT_EQ(again.at("from"), "file");
  EXPECT_EQ(again.at("value"), json({49, 49, 49}));
  EXPECT_EQ(key_of({"--config", file}, "run.method").at("value"), "auto");
}

TEST(Config, EveryNumberSaysItsUnitOrCountsNothing) {
  Program program = Program::forcegrid({"config", "--json"});
  ASSERT_EQ(program.wait(kTimeout), 0);
  std::string without;
  const json shown = json::parse(program.standard_output());
  for (const json& key : shown.at("keys")) {
    const bool number = key.at("type") == "number" || key.at("type") == "integer";
    const std::string name = key.at("key");
    const bool no_unit = name.ends_with(".seed") || name.ends_with(".friction") ||
                         name.ends_with(".tool-number");  // a ratio, a name
    if (number && key.at("unit").get<std::string>().empty() && !no_unit) {
      without += name + " ";
    }
    EXPECT_NE(key.at("description"), "") << name;
  }
  EXPECT_EQ(without, "");
}

// Key, built-in and value of every row; the words of a meaning may be changed in one place.
std::vector<std::string> rows_of(std::istream& text) {
  std::vector<std::string> rows;
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("### ")) {
      rows.push_back(line);
    } else if (line.starts_with("| `")) {
      rows.push_back(line.substr(0, line.rfind(" | ")));
    }
  }
  return rows;
}

TEST(Config, PageHasTheTableThatTheProgramPrints) {
  Program program = Program::forcegrid({"config", "--markdown"});
  ASSERT_EQ(program.wait(kTimeout), 0);
  std::istringstream printed(program.standard_output());
  std::ifstream page(FORCEGRID_SOURCE_DIR "/docs/config.md");
  const std::vector<std::string> expected = rows_of(printed);
  EXPECT_GT(expected.size(), 40u);
  EXPECT_EQ(rows_of(page), expected)
      << "write what `forcegrid --no-config config --markdown` prints under \"The keys\"";
}

}  // namespace
}  // namespace forcegrid
