// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid::cli {
namespace {

namespace fs = std::filesystem;
using forcegrid::testing::Program;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr std::chrono::seconds kTimeout{30};
const std::string kTools = std::string(FORCEGRID_PROGRAM) + "-tools";

/// A copy of `forcegrid` without forcegrid-tools beside it.
std::string copy_in(const fs::path& folder) {
  fs::create_directories(folder);
  const fs::path copy = folder / "forcegrid";
  fs::copy_file(FORCEGRID_PROGRAM, copy, fs::copy_options::overwrite_existing);
  return copy.string();
}

void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

struct Ended {
  int status = -1;
  std::string out;
  std::string err;
};

Ended run(const std::vector<std::string>& command) {
  Program program(command);
  const int status = program.wait(kTimeout).value_or(-1);
  return {status, program.standard_output(), program.standard_error()};
}

TEST(ToolsProgram, WhereItIsNotInstalledThePackageIsNamed) {
  const std::string folder = forcegrid::testing::fresh_folder("tools_not_installed");
  const std::string program = copy_in(folder + "/bin");
  const Ended ended = run({program, "chart", "accuracy", "--out", folder});
  EXPECT_EQ(ended.status, 1);
  EXPECT_THAT(ended.err, HasSubstr("'chart' is in the program forcegrid-tools"));
  EXPECT_THAT(ended.err, HasSubstr(folder + "/bin/forcegrid-tools"));
  EXPECT_THAT(ended.err, HasSubstr("install the package forcegrid-tools"));
  EXPECT_THAT(run({program, "simulate", "--scene", "small", "--bench"}).err,
              HasSubstr("'simulate --bench' is in the program forcegrid-tools"));
}

TEST(ToolsProgram, InABuildFolderOfOnesOwnTheCommandThatBuildsItIsNamed) {
  const std::string folder = forcegrid::testing::fresh_folder("tools_own_folder");
  const std::string program = copy_in(folder + "/mine/bin");
  write(folder + "/mine/CMakeCache.txt", "CMAKE_HOME_DIRECTORY:INTERNAL=" + folder + "\n");
  const Ended ended = run({program, "--no-config", "tune"});
  EXPECT_EQ(ended.status, 1);
  EXPECT_THAT(ended.err, HasSubstr("cmake -DFORCEGRID_BUILD_TOOLS=ON " + folder + "/mine"));
}

// The Makefile stands for the project's, which takes minutes.
TEST(ToolsProgram, InTheBuildFolderOfMakeItIsBuiltAndTakesOver) {
  const std::string folder = forcegrid::testing::fresh_folder("tools_built");
  const std::string program = copy_in(folder + "/build/release/bin");
  write(folder + "/build/release/CMakeCache.txt",
        "CMAKE_GENERATOR:INTERNAL=Ninja\nCMAKE_HOME_DIRECTORY:INTERNAL=" + folder + "\n");
  write(folder + "/Makefile",
        "tools:\n\t@echo building\n\t@cp " + kTools + " build/release/bin/\n");
  const Ended first = run({program, "chart", "--help"});
  EXPECT_EQ(first.status, 0) << first.err;
  EXPECT_THAT(first.err, HasSubstr("make -C " + folder + " tools"));
  EXPECT_THAT(first.err, HasSubstr("building\n"));
  EXPECT_THAT(first.out, Not(HasSubstr("building\n"))) << "scripts read standard output";
  EXPECT_THAT(first.out, HasSubstr("accuracy"));
  const Ended second = run({program, "chart", "--help"});
  EXPECT_EQ(second.status, 0);
  EXPECT_EQ(second.err, "") << "it is there now";

  fs::remove(folder + "/build/release/bin/forcegrid-tools");
  write(folder + "/Makefile", "tools:\n\t@echo no compiler >&2; exit 1\n");
  const Ended failed = run({program, "chart", "--help"});
  EXPECT_EQ(failed.status, 1);
  EXPECT_THAT(failed.err, HasSubstr("no compiler"));
  EXPECT_THAT(failed.err, HasSubstr("could not be built"));
}

TEST(ToolsProgram, KeysOfItsCommandsAreLeftToIt) {
  const std::string folder = forcegrid::testing::fresh_folder("tools_keys");
  const std::string program = copy_in(folder + "/bin");
  const std::string config = folder + "/config.toml";
  write(config, "[chart.accuracy]\nquick = true\n[run]\nrate = 750\n");
  const Ended shown = run({program, "--config", config, "config", "run.rate"});
  EXPECT_EQ(shown.status, 0) << shown.err;
  EXPECT_THAT(shown.out, HasSubstr("rate = 750"));
  EXPECT_THAT(shown.err, HasSubstr("the keys of calibrate, tune,"));
  write(config, "[chart.accuracy]\nquikc = true\n");
  const Ended wrong = run({FORCEGRID_PROGRAM, "--config", config, "chart", "accuracy"});
  EXPECT_EQ(wrong.status, 2);
  EXPECT_THAT(wrong.err, HasSubstr("chart.accuracy.quick")) << "forcegrid-tools checks them";
}

TEST(ToolsProgram, BothListTheSameCommands) {
  EXPECT_EQ(run({FORCEGRID_PROGRAM, "--help"}).out, run({kTools, "--help"}).out);
}

}  // namespace
}  // namespace forcegrid::cli
