// SPDX-License-Identifier: Apache-2.0
// Programs of their own at a simulator that stands still now and then: alone on the machine, since
// any other test beside them would hold the simulator up, too.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/cli/run/two_arms.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(60);

// A simulator that stood still while it answered a request must not take every later one for as
// long.
TEST(SeveralRuns, GetTheirRequestsAnsweredAfterTheSimulatorStoodStill) {
  Program simulator = Program::forcegrid(
      {"simulate", "--tools", "2", "--scene", "small", "--listen", "127.0.0.1:0"});
  const std::string address = testing::address_in(simulator.wait_for_line("listening "));
  const auto with_requests = [&](const char* tool, const char* y_mm, const std::string& folder) {
    std::vector<std::string> arguments = testing::servo_at(address, tool, y_mm, folder, "8");
    for (const char* more : {"--method", "forcegrid+request", "--requests-per-s", "60"}) {
      arguments.emplace_back(more);
    }
    return arguments;
  };
  const std::string left_folder = fresh_folder("left_requests");
  const std::string right_folder = fresh_folder("right_requests");
  Program left = Program::forcegrid(with_requests("1", "-15", left_folder));
  Program right = Program::forcegrid(with_requests("2", "15", right_folder));
  ASSERT_TRUE(left.wait_for_text("Samples come"));
  ASSERT_TRUE(right.wait_for_text("Samples come"));
  for (int stop = 0; stop < 20; ++stop) {  // one of them hits an answer
    simulator.send_signal(SIGSTOP);
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    simulator.send_signal(SIGCONT);
    std::this_thread::sleep_for(std::chrono::milliseconds(40));
  }
  EXPECT_EQ(left.wait(kTimeout), 0) << left.standard_error();
  EXPECT_EQ(right.wait(kTimeout), 0) << right.standard_error();
  for (const std::string& folder : {left_folder, right_folder}) {
    const json summary = json::parse(testing::text_of(folder + "/run.json"));
    EXPECT_GT(4 * summary.at("answers_taken").get<int>(), summary.at("requests_made").get<int>());
  }
}

}  // namespace
}  // namespace forcegrid
