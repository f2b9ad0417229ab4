// SPDX-License-Identifier: Apache-2.0
// `forcegrid tune` with a device at a real kernel. How well the guest keeps time is not looked at.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/hil/hil_bench.h"
#include "tests/hil/tool_answers.h"

namespace forcegrid::hil {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

TEST(LongTune, ARateAboveTheDevicesPaceIsRefusedWithTheReasonBeforeAnythingMoves) {
  Bench bench;
  const ShellResult refused =
      as_user("operator", "forcegrid tune --device hid:path=" + bench.node().port +
                              " --rates 500,2000 --out /tmp/out-tune");
  EXPECT_EQ(refused.status, 1) << refused.text;
  EXPECT_THAT(refused.text,
              HasSubstr("--rates 2000: woodenhaptics_v2015 answers once per bus frame "
                        "of 1000 us, at most 1000 times per second"));
  EXPECT_THAT(refused.text, HasSubstr("need a high-speed device, or simulated time"));
  const json emulator = bench.end();
  EXPECT_EQ(emulator.at("reports_received"), 0) << "it was given commands";
}

TEST(LongTune, AVisitorIsToldWhyThereIsNoPathToTuneOn) {
  Bench bench;
  const ShellResult refused =
      as_user("visitor", "forcegrid tune --device hid:path=" + bench.node().port +
                             " --methods hold --rates 250 --time 20 --out /tmp/out-visitor");
  EXPECT_EQ(refused.status, 1) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("open " + bench.node().dev() + ": Permission denied"));
  EXPECT_THAT(refused.text, HasSubstr("no path was recorded"));
  EXPECT_EQ(bench.end().at("reports_received"), 0);
}

// Two runs, of the path and of the one setting, on a device that stays plugged in.
TEST(LongTune, AShortSweepIsWrittenAndTheNextCommandTakesIt) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const Answer tuned =
      ask("operator", "tune --device hid:path=" + bench.node().port + " --scene " + tiny_scene() +
                          " --calibrated --methods rls --rates 250 --time 20 --error-percent 50 "
                          "--missed-percent 100 --compute-percent 1e6 --margin-percent 0 --out "
                          "/tmp/out-sweep --write");
  ASSERT_EQ(tuned.status, 0) << tuned.result.dump(2);
  EXPECT_EQ(tuned.result.at("written"), "/tmp/.config/forcegrid/config.toml");
  EXPECT_EQ(tuned.result.at("chosen").at("method"), "rls");
  EXPECT_LT(tuned.result.at("chosen").at("error_percent"), 50.0);
  const Answer next = ask("operator", "config run.method run.rate");
  for (const json& key : next.result.at("keys")) {
    EXPECT_EQ(key.at("from"), "user") << key;
    EXPECT_EQ(key.at("value"), key.at("key") == "run.rate" ? json(250) : json("rls"));
  }
  const json emulator = bench.end();
  EXPECT_EQ(emulator.at("final_current_mA"), json({0.0, 0.0, 0.0})) << emulator;
  EXPECT_EQ(emulator.at("counters_loaded"), 0) << "somebody was asked for the button";
  fs::remove_all("/tmp/.config");
}

}  // namespace
}  // namespace forcegrid::hil
