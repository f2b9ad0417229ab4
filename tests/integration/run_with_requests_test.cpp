// SPDX-License-Identifier: Apache-2.0
// A method that asks the simulator for forces where it wants them, through the whole path.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

TEST(RunWithRequests, GetsAnswersOfTheSimulatorInItsIdleTime) {
  Program run = Program::forcegrid({"run", "--scene", "small", "--seconds", "5", "--method",
                                    "forcegrid+request", "--evaluate", "hold", "--no-reference",
                                    "--out", fresh_folder("requests"), "--json"});
  ASSERT_EQ(run.wait(std::chrono::seconds(60)), 0) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  const int made = summary.at("requests_made").get<int>();
  const int taken = summary.at("answers_taken").get<int>();
  // 120 a second of contact, which lasts some seconds; the small block is solved in a millisecond.
  EXPECT_GT(made, 100);
  EXPECT_LT(made, 5 * 120 + 5);
  EXPECT_GT(taken, made / 4);
  EXPECT_LE(taken, made);
  EXPECT_EQ(summary.at("samples_rejected"), 0);
  EXPECT_GE(summary.at("simulator").at("replies").get<int>(), taken);
}

TEST(RunWithRequests, RefusesWhatItCannotServe) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> refused = {
      {{"--evaluate", "forcegrid+request"}, "only the rendered method's requests"},
      {{"--method", "forcegrid+request", "--requests-per-s", "0"}, "works only with requests"},
      {{"--workers", "1", "--simulator", "127.0.0.1:1"}, "forcegrid worker"},
      {{"--method", "forcegrid+request", "--requests-per-s", "600"},
       "at most one request per cycle"}};
  for (auto [arguments, words] : refused) {
    arguments.insert(arguments.begin(), {"run", "--seconds", "1"});
    Program run = Program::forcegrid(arguments);
    EXPECT_EQ(run.wait(std::chrono::seconds(20)), 1);
    EXPECT_THAT(run.standard_error(), HasSubstr(words));
  }
}

}  // namespace
}  // namespace forcegrid
