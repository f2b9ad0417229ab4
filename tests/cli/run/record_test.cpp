// SPDX-License-Identifier: Apache-2.0
// `forcegrid run --record`, and what `forcegrid evaluate` makes of the recording.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "evaluation/traces/trace.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

TEST(Record, MakesATraceOnWhichMethodsHaveTheErrorsOfTheRun) {
  const std::string out = fresh_folder("record");
  const std::string trace_file = out + "/run.csv.gz";
  // All filling at once, as evaluate does.
  Program run = Program::forcegrid({"run", "--scene", "small", "--seconds", "5", "--fill-budget",
                                    "100000", "--record", trace_file, "--out", out, "--json"});
  ASSERT_EQ(run.wait(std::chrono::seconds(90)), 0) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_THAT(summary.at("files").dump(), HasSubstr("run.csv.gz"));

  const evaluation::Trace trace = evaluation::read_trace(trace_file);
  EXPECT_GT(trace.servo.size(), 500u);
  EXPECT_GT(trace.samples.size(), 30u);
  ASSERT_EQ(trace.events.size(), 1u);  // the block is sticky
  EXPECT_TRUE(trace.events.front().made);
  EXPECT_EQ(trace.events.front().time_s, 0.0);
  EXPECT_EQ(trace.samples.front().sample.time_s, 0.0);
  EXPECT_GT(trace.samples.front().delivered_s, 0.0);
  EXPECT_TRUE(trace.samples.front().sample.has_stiffness);

  // The device's workspace and a sixth of its longest side are what run gives to its methods.
  Program evaluate = Program::forcegrid({"evaluate", "--method", "hold", "--method", "forcegrid",
                                         "--workspace", "-0.06,-0.08,-0.06,0.06,0.08,0.06", "--r",
                                         "0.02666666667", "--trace", trace_file});
  ASSERT_EQ(evaluate.wait(std::chrono::seconds(60)), 0) << evaluate.standard_error();
  const json figures = json::parse(evaluate.standard_output());
  for (const char* method : {"hold", "forcegrid"}) {
    for (const char* key : {"rms_error_percent_after_1s", "rms_error_percent_first_1s",
                            "max_error_percent_after_1s"}) {
      // A sample that arrives while a cycle begins may count for this cycle or for the next.
      const double of_run = summary.at("errors").at(method).at(key).get<double>();
      const double of_trace = figures.at(method).at(key).get<double>();
      EXPECT_NEAR(of_trace, of_run, 0.05 * of_run + 0.05) << method << " " << key;
    }
  }
}

TEST(Record, IsRefusedWhereNoReferenceWillBe) {
  const std::string file = fresh_folder("record") + "/run.csv";
  const std::vector<std::pair<std::vector<std::string>, std::string>> refused = {
      {{"--no-reference", "--record", file}, "--no-reference"},
      {{"--simulator", "127.0.0.1:9", "--record", file}, "--scene instead of --simulator"},
      {{"--record", "/no-such-folder/run.csv"}, "--record /no-such-folder/run.csv"}};
  for (auto [arguments, word] : refused) {
    arguments.insert(arguments.begin(), {"run", "--seconds", "1"});
    Program run = Program::forcegrid(arguments);
    EXPECT_EQ(run.wait(std::chrono::seconds(20)), 1);
    EXPECT_THAT(run.standard_error(), HasSubstr(word));
    EXPECT_FALSE(std::filesystem::exists(file));
  }
}

TEST(Record, FailsAloudWhenTheToolNeverTouched) {
  const std::string out = fresh_folder("record");
  Program run = Program::forcegrid({"run", "--scene", "small", "--hand", "none", "--seconds", "1",
                                    "--record", out + "/run.csv", "--out", out, "--json"});
  EXPECT_EQ(run.wait(std::chrono::seconds(60)), 1);
  EXPECT_THAT(run.standard_error(), HasSubstr("no trace was recorded"));
  EXPECT_THAT(run.standard_output(), HasSubstr("no trace was recorded"));  // among the notes
  EXPECT_FALSE(std::filesystem::exists(out + "/run.csv"));
}

}  // namespace
}  // namespace forcegrid
