// SPDX-License-Identifier: Apache-2.0
// `forcegrid tune` on the emulated arm.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(100);

// On the small block's chirp, holding the last sample errs by some 5 %, rls by less than 1 %: the
// tolerance lies between, and the machine's misses are not what is tested. The time is twice what a
// path and one setting take: a busy machine starts programs slowly.
TEST(TuneCommand, ProposesTheCheapestMethodThatIsGoodEnoughAndWritesIt) {
  const std::string folder = fresh_folder("tune");
  setenv("XDG_CONFIG_HOME", folder.c_str(), 1);
  Program tune =
      Program::forcegrid({"tune", "--methods", "hold;rls", "--rates", "250", "--time", "40",
                          "--error-percent", "2", "--missed-percent", "100", "--compute-percent",
                          "1e6", "--out", folder, "--write", "--json"});
  ASSERT_EQ(tune.wait(kTimeout), 0) << tune.standard_error();
  const json result = json::parse(tune.standard_output());
  EXPECT_EQ(result.at("settings").size(), 2u);
  EXPECT_EQ(result.at("chosen").at("method"), "rls");
  EXPECT_EQ(result.at("chosen").at("rate_Hz"), 250.0);
  EXPECT_GT(result.at("settings")[0].at("path_error_percent"), 2.0);
  EXPECT_EQ(result.at("next_cheaper").at("method"), "hold");
  EXPECT_TRUE(result.at("chosen").at("measured").get<bool>());
  EXPECT_GT(result.at("chosen").at("compute_p50_us"), 0.0);
  EXPECT_GT(result.at("chosen").at("stability_margin"), 1.0);
  EXPECT_TRUE(std::filesystem::exists(folder + "/tuning.svg"));
  EXPECT_TRUE(result.at("picture_problem").is_null());
  // The simulator of each run says the same: it is said once, and at the end how often.
  const std::string said = tune.standard_error();
  const std::string solver = "[run/simulator] solver ";
  const std::size_t first = said.find(solver);
  const std::size_t count = said.find(solver, first + 1);
  ASSERT_NE(first, std::string::npos) << said;
  ASSERT_NE(count, std::string::npos) << said;
  EXPECT_THAT(said.substr(count, said.find('\n', count) - count), HasSubstr(" more time"));
  EXPECT_EQ(said.find(solver, count + 1), std::string::npos) << said;
  EXPECT_THAT(said, ::testing::Not(HasSubstr("[run] ")));
  // And that is what the next run takes.
  Program config({FORCEGRID_PROGRAM, "config", "run.method", "run.rate", "--json"});
  ASSERT_EQ(config.wait(kTimeout), 0) << config.standard_error();
  const json keys = json::parse(config.standard_output()).at("keys");
  for (const json& key : keys) {
    EXPECT_EQ(key.at("from"), "user") << key;
    EXPECT_EQ(key.at("value"), key.at("key") == "run.rate" ? json(250) : json("rls"));
  }
  unsetenv("XDG_CONFIG_HOME");
}

TEST(TuneCommand, SucceedsWithAWarningWhenThePicturesCantBeDrawn) {
  const std::string folder = fresh_folder("tune");
  const std::string path = std::getenv("PATH");
  std::ofstream(folder + "/gnuplot") << "#!/bin/sh\nexit 1\n";
  std::filesystem::permissions(folder + "/gnuplot", std::filesystem::perms::owner_all);
  setenv("PATH", (folder + ":" + path).c_str(), 1);
  Program tune = Program::forcegrid({"tune", "--methods", "rls", "--rates", "250", "--time", "40",
                                     "--error-percent", "5", "--missed-percent", "100",
                                     "--compute-percent", "1e6", "--out", folder, "--json"});
  EXPECT_EQ(tune.wait(kTimeout), 0) << "a script wants the proposal, which there is";
  setenv("PATH", path.c_str(), 1);
  EXPECT_THAT(tune.standard_error(), HasSubstr("Warning: no picture of the tuning"));
  EXPECT_THAT(tune.standard_error(), HasSubstr("gnuplot could not draw"));
  const json result = json::parse(tune.standard_output());
  EXPECT_EQ(result.at("chosen").at("method"), "rls");
  EXPECT_GT(result.at("chosen").at("method_us"), 0.0);
  EXPECT_THAT(result.at("picture_problem").get<std::string>(), HasSubstr("gnuplot"));
  EXPECT_EQ(result.at("files").size(), 1u) << result.at("files");
  EXPECT_TRUE(std::filesystem::exists(folder + "/tuning.csv"));
}

TEST(TuneCommand, RefusesWhatTheDeviceOrTheTimeCantGive) {
  Program fast = Program::forcegrid({"tune", "--rates", "500,2000", "--out", fresh_folder("tune")});
  EXPECT_EQ(fast.wait(kTimeout), 1);
  EXPECT_THAT(fast.standard_error(), HasSubstr("at most 1000 times per second"));
  EXPECT_THAT(fast.standard_error(), HasSubstr("simulated time"));
  Program hasty = Program::forcegrid({"tune", "--time", "5", "--out", fresh_folder("tune")});
  EXPECT_EQ(hasty.wait(kTimeout), 1);
  EXPECT_THAT(hasty.standard_error(),
              HasSubstr("recording a path and trying one setting take 20 s"));
}

}  // namespace
}  // namespace forcegrid
