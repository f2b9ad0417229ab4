// SPDX-License-Identifier: Apache-2.0
// A simulator's queries answered by other processes, some of which end or halt.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

TEST(RunWithWorkers, HasTwoOfThemAnswerQueries) {
  const std::string temporary = fresh_folder("workers_temporary");
  std::vector<std::string> command =
      testing::forcegrid_command({"run", "--scene", "small", "--seconds", "4", "--workers", "2",
                                  "--method", "forcegrid+request", "--evaluate", "hold",
                                  "--no-reference", "--out", fresh_folder("workers"), "--json"});
  command.insert(command.begin(), {"/usr/bin/env", "TMPDIR=" + temporary});
  Program run(command);
  ASSERT_TRUE(run.wait_for_text("in contact"));
  EXPECT_TRUE(std::filesystem::is_empty(temporary)) << "a run that is killed would leave its key";
  ASSERT_EQ(run.wait(std::chrono::seconds(60)), 0) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_GT(summary.at("answers_taken").get<int>(), 20);
  EXPECT_TRUE(summary.at("link").at("clock_known").get<bool>());  // under the workers' key
  const json& workers = summary.at("simulator").at("workers");
  EXPECT_GE(workers.at("joined").get<int>(), 2);
  EXPECT_EQ(workers.at("expelled"), 0);
  EXPECT_EQ(workers.at("malformed"), 0);
  EXPECT_GE(workers.at("jobs_given"), workers.at("answers"));
  ASSERT_GE(workers.at("each").size(), 2U);
  for (const json& worker : workers.at("each")) {
    EXPECT_GT(worker.at("answers").get<int>(), 0) << workers;
    EXPECT_THAT(run.standard_error(), HasSubstr("worker " + worker.at("name").get<std::string>()));
  }
}

TEST(RunWithWorkers, LosesTheirOwnAnswersWhenOneIsKilledAndAnotherHalted) {
  const std::string key = fresh_folder("killed") + "/link.key";
  ASSERT_EQ(Program::forcegrid({"keygen", key}).wait(), 0);
  Program simulator = Program::forcegrid({"simulate", "--scene", "small", "--listen", "127.0.0.1:0",
                                          "--workers", "127.0.0.1:0", "--key", key, "--json"});
  std::istringstream words(simulator.wait_for_line("listening "));
  const std::vector<std::string> said{std::istream_iterator<std::string>(words), {}};
  ASSERT_GE(said.size(), 4U);
  const auto worker = [&] {
    return Program::forcegrid(
        {"worker", "--connect", said.back(), "--key", key, "--scene", "small"});
  };
  const Program killed = worker();
  const Program halted = worker();
  ASSERT_NE(killed.wait_for_line("working for "), "");
  ASSERT_NE(halted.wait_for_line("working for "), "");
  Program run =
      Program::forcegrid({"run", "--simulator", said.at(1), "--key", key, "--seconds", "5",
                          "--method", "forcegrid+request", "--evaluate", "hold", "--no-reference",
                          "--out", fresh_folder("killed_run"), "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact"));
  killed.send_signal(SIGKILL);
  halted.send_signal(SIGSTOP);
  const auto lost = std::chrono::steady_clock::now();
  EXPECT_EQ(run.wait(std::chrono::seconds(60)), 0) << run.standard_error();
  // A worker that has a job when it goes is missed after 4 s of silence.
  std::this_thread::sleep_until(lost + std::chrono::seconds(6));
  halted.send_signal(SIGCONT);
  simulator.send_signal(SIGINT);
  EXPECT_EQ(simulator.wait(), 130) << simulator.standard_error();

  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  // One from each worker at most is lost to the contact; the simulator does the rest itself.
  EXPECT_GT(summary.at("answers_taken").get<int>(), summary.at("requests_made").get<int>() / 4);
  const std::string report = simulator.standard_output();
  const json workers = json::parse(report.substr(report.find('{'))).at("workers");
  EXPECT_GE(workers.at("joined").get<int>(), 2);
  EXPECT_GE(workers.at("gone").get<int>(), 2) << workers;
  EXPECT_EQ(workers.at("wrong"), 0);
}

}  // namespace
}  // namespace forcegrid
