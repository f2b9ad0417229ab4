// A method that asks the simulator for forces where it wants them, through the whole path.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "tests/integration/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

TEST(RunWithRequests, GetsAnswersOfTheSimulatorInItsIdleTime) {
  Program run = Program::forcegrid({"run", "--scene", "small", "--seconds", "5", "--method",
                                    "forcegrid+request", "--shadow", "hold", "--no-truth", "--out",
                                    fresh_folder("requests"), "--json"});
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

TEST(RunWithRequests, HasTwoWorkersAnswerThem) {
  Program run = Program::forcegrid({"run", "--scene", "small", "--seconds", "5", "--workers", "2",
                                    "--method", "forcegrid+request", "--shadow", "hold",
                                    "--no-truth", "--out", fresh_folder("workers"), "--json"});
  ASSERT_EQ(run.wait(std::chrono::seconds(60)), 0) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_GT(summary.at("answers_taken").get<int>(), 50);
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

TEST(RunWithRequests, LosesTheirOwnAnswersWhenOneWorkerIsKilledAndAnotherHalted) {
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
  Program run = Program::forcegrid({"run", "--simulator", said.at(1), "--key", key, "--seconds",
                                    "7", "--method", "forcegrid+request", "--shadow", "hold",
                                    "--no-truth", "--out", fresh_folder("killed_run"), "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact"));
  killed.send_signal(SIGKILL);
  halted.send_signal(SIGSTOP);
  EXPECT_EQ(run.wait(std::chrono::seconds(60)), 0) << run.standard_error();
  halted.send_signal(SIGCONT);
  simulator.send_signal(SIGINT);
  EXPECT_EQ(simulator.wait(), 0) << simulator.standard_error();

  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  // One from each worker at most is lost to the contact; the simulator does the rest itself.
  EXPECT_GT(summary.at("answers_taken").get<int>(), summary.at("requests_made").get<int>() / 4);
  const std::string report = simulator.standard_output();
  const json workers = json::parse(report.substr(report.find('{'))).at("workers");
  EXPECT_GE(workers.at("gone").get<int>(), 1) << workers;
  EXPECT_GE(workers.at("jobs_taken_back").get<int>(), 1) << workers;
  EXPECT_EQ(workers.at("wrong"), 0);
}

TEST(RunWithRequests, RefusesWhatItCannotServe) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> refused = {
      {{"--shadow", "forcegrid+request"}, "only the rendered method's requests"},
      {{"--method", "forcegrid+request", "--requests-per-s", "0"}, "lives on its requests"},
      {{"--workers", "1", "--simulator", "127.0.0.1:1"}, "forcegrid worker"},
      {{"--method", "forcegrid+request", "--requests-per-s", "600"}, "a request a cycle at most"}};
  for (auto [arguments, words] : refused) {
    arguments.insert(arguments.begin(), {"run", "--seconds", "1"});
    Program run = Program::forcegrid(arguments);
    EXPECT_EQ(run.wait(std::chrono::seconds(20)), 1);
    EXPECT_THAT(run.standard_error(), HasSubstr(words));
  }
}

}  // namespace
}  // namespace forcegrid
