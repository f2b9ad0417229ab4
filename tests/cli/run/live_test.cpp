// SPDX-License-Identifier: Apache-2.0
// `forcegrid run --live` in a pseudo-terminal of 80 x 24, and out of it on every way.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstring>
#include <string>
#include <vector>

#include "tests/support/in_terminal.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::InTerminal;
using testing::kEnterScreen;
using testing::kLeaveScreen;
using testing::Program;

std::vector<std::string> live_run(const std::string& seconds) {
  return testing::forcegrid_command({"run", "--live", "--scene", "small", "--seconds", seconds,
                                     "--no-reference", "--out", fresh_folder("live")});
}

TEST(Live, DrawsTheLoopAndGivesTheTerminalBackAtTheEnd) {
  InTerminal run(live_run("5"));
  ASSERT_TRUE(run.wait_for(kEnterScreen)) << run.seen();
  ASSERT_TRUE(run.wait_for("of 500 cycles/s")) << run.seen();
  EXPECT_TRUE(run.gave_the_terminal_back());
  EXPECT_THAT(run.seen_afterwards(), HasSubstr("Wrote"));  // the summary
}

TEST(Live, ShowsTheSentencesOfTheLoopAndPrintsThemAtTheEnd) {
  InTerminal run(live_run("60"));
  ASSERT_TRUE(run.wait_for("s  Samples come; the force ramps in.")) << run.seen();
  EXPECT_EQ(run.seen().rfind(kLeaveScreen), std::string::npos) << "it is shown in the picture";
  run.send_signal(SIGINT);
  EXPECT_TRUE(run.gave_the_terminal_back());
  EXPECT_THAT(run.seen_afterwards(), HasSubstr("s  Samples come; the force ramps in."));
}

TEST(Live, GivesTheTerminalBackOnEverySignal) {
  for (const int number : {SIGINT, SIGTERM, SIGSEGV, SIGABRT}) {
    InTerminal run(live_run("60"));
    ASSERT_TRUE(run.wait_for("of 500 cycles/s")) << run.seen();
    run.send_signal(number);
    EXPECT_TRUE(run.gave_the_terminal_back()) << strsignal(number);
  }
}

TEST(Live, LeavesTheScreenWhileItIsStopped) {
  InTerminal run(live_run("60"));
  ASSERT_TRUE(run.wait_for("of 500 cycles/s")) << run.seen();
  run.forget();
  run.send_signal(SIGTSTP);
  EXPECT_TRUE(run.wait_for(kLeaveScreen));
  ASSERT_TRUE(run.wait_until_stopped());
  run.forget();
  run.send_signal(SIGCONT);
  EXPECT_TRUE(run.wait_for(kEnterScreen));
}

TEST(Live, IsRefusedWithoutATerminal) {
  Program run = Program::forcegrid({"run", "--live", "--seconds", "1"});
  EXPECT_EQ(run.wait(std::chrono::seconds(20)), 1);
  EXPECT_THAT(run.standard_error(), HasSubstr("ssh -t"));
}

}  // namespace
}  // namespace forcegrid
