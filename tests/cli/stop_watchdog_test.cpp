// SPDX-License-Identifier: Apache-2.0
#include "cli/common/stop_watchdog.h"

#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <optional>
#include <thread>

#include "cli/common/stop_request.h"

namespace forcegrid::cli {
namespace {

using namespace std::chrono_literals;

constexpr int kOwnStatus = 7;

// Interrupted while a device is open, a command of its own end needs `end`, and a little more to
// leave with its status.
[[noreturn]] void interrupted_command(std::chrono::milliseconds end, bool has_own_end) {
  StopRequest::install();
  const StopWatchdog watchdog(false);
  std::optional<OwnEnd> own_end;
  if (has_own_end) {
    own_end.emplace();
  }
  static_cast<void>(raise(SIGINT));
  std::this_thread::sleep_for(end);
  own_end.reset();
  std::this_thread::sleep_for(100ms);
  std::_Exit(kOwnStatus);
}

class StopWatchdogDeathTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { GTEST_FLAG_SET(death_test_style, "threadsafe"); }
};

TEST_F(StopWatchdogDeathTest, LeavesACommandOfItsOwnEndTheTimeToLeaveWithItsStatus) {
  EXPECT_EXIT(interrupted_command(1500ms, true), ::testing::ExitedWithCode(kOwnStatus), "");
}

TEST_F(StopWatchdogDeathTest, EndsAnyOtherThatDoesNotEnd) {
  EXPECT_EXIT(interrupted_command(60s, false), ::testing::ExitedWithCode(128 + SIGINT),
              "stopped by SIGINT\n");
}

TEST_F(StopWatchdogDeathTest, SaysTheTextOfACommandThatHadNoTimeToSayIt) {
  EXPECT_EXIT(
      {
        const StoppedText text("stopped; what was finished is kept");
        interrupted_command(60s, false);
      },
      ::testing::ExitedWithCode(128 + SIGINT), "stopped by SIGINT; what was finished is kept\n");
  EXPECT_EXIT(
      {
        { const StoppedText text("stopped; what was finished is kept"); }
        interrupted_command(60s, false);
      },
      ::testing::ExitedWithCode(128 + SIGINT), "stopped by SIGINT\n");
}

}  // namespace
}  // namespace forcegrid::cli
