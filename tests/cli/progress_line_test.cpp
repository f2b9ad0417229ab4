// SPDX-License-Identifier: Apache-2.0
#include "cli/common/progress_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <memory>
#include <string>
#include <thread>

#include "log/log.h"
#include "tests/support/in_terminal.h"
#include "tests/support/program.h"

namespace forcegrid::cli {
namespace {

using forcegrid::testing::InTerminal;
using forcegrid::testing::Program;
using ::testing::HasSubstr;
using ::testing::Not;
using namespace std::chrono_literals;

/// What a line shows in a file in place of a terminal.
class Shown {
 public:
  Shown() : file_(std::tmpfile()) {}
  ~Shown() { std::fclose(file_); }
  Shown(const Shown&) = delete;
  Shown& operator=(const Shown&) = delete;

  ProgressOptions options(bool terminal, std::chrono::milliseconds quiet = 0ms) const {
    return {.out = file_, .terminal = terminal, .quiet = quiet, .log_period = 50ms};
  }
  std::string text() const {
    std::string text;
    std::rewind(file_);
    for (int c = std::fgetc(file_); c != EOF; c = std::fgetc(file_)) {
      text += static_cast<char>(c);
    }
    return text;
  }
  /// Waits for it, for as long as a busy machine may need.
  bool comes(const std::string& part) const {
    for (int i = 0; i < 200; ++i) {
      if (text().find(part) != std::string::npos) {
        return true;
      }
      std::this_thread::sleep_for(50ms);
    }
    return false;
  }

 private:
  std::FILE* file_;
};

TEST(ProgressLine, WritesDurationsForPeople) {
  EXPECT_EQ(time_text(0.0), "0 s");
  EXPECT_EQ(time_text(59.4), "59 s");
  EXPECT_EQ(time_text(185.0), "3 min 05 s");
  EXPECT_EQ(time_text(3599.9), "1 h 00 min");
  EXPECT_EQ(time_text(7800.0), "2 h 10 min");
  EXPECT_EQ(time_text(-1.0), "0 s");
}

TEST(ProgressLine, SaysNothingOfShortWork) {
  const Shown shown;
  {
    ProgressLine line(shown.options(true, 60s));
    line.begin("Loading");
    line.show("Loading", 0.5, 3.0);
    line.clear();
  }
  EXPECT_EQ(shown.text(), "");
}

TEST(ProgressLine, IsRewrittenOnATerminalAndErasedAtTheEnd) {
  const Shown shown;
  {
    ProgressLine line(shown.options(true));
    line.show("Solving", 0.25, 600.0);
    ASSERT_TRUE(shown.comes("Solving"));
  }
  EXPECT_THAT(shown.text(), HasSubstr("\r\033[KSolving:  25 %, 10 min 00 s left"));
  EXPECT_THAT(shown.text(), Not(HasSubstr("\n")));
  EXPECT_TRUE(shown.text().ends_with("\r\033[K"));
}

TEST(ProgressLine, IsALineNowAndThenElsewhere) {
  const Shown shown;
  ProgressLine line(shown.options(false));
  line.show("Solving", 0.25, 600.0);
  ASSERT_TRUE(shown.comes(" left\nSolving:"));
  EXPECT_THAT(shown.text(), Not(HasSubstr("\r")));
}

TEST(ProgressLine, GoesOnDuringALongStep) {
  const Shown shown;
  ProgressLine line(shown.options(false));
  line.begin("Loading scene x");
  EXPECT_TRUE(shown.comes("Loading scene x: 1 s so far\n"));
  line.begin("measuring", 3.0);
  EXPECT_TRUE(shown.comes(", 1 s left\n")) << "and a known length counts down";
}

TEST(ProgressLine, EstimatesTheTimeLeftFromTheTimeTaken) {
  const Shown shown;
  ProgressLine line(shown.options(false));
  line.show("Return test", 0.0);
  std::this_thread::sleep_for(1s);
  line.show("Return test", 0.01);
  ASSERT_TRUE(shown.comes("  1 %, "));
  // 1 s for a hundredth: 99 s are left, and more where this machine stood still.
  EXPECT_THAT(shown.text().substr(shown.text().find("  1 %, ")),
              ::testing::ContainsRegex("^  1 %, [1-9][0-9]* min [0-5][0-9] s left"));
}

TEST(ProgressLine, LetsOthersPrint) {
  const Shown shown;
  ProgressLine line(shown.options(true));
  line.show("Return test", 0.2, 30.0);
  ASSERT_TRUE(shown.comes("20 %"));
  line.pause();
  const std::string paused = shown.text();
  EXPECT_TRUE(paused.ends_with("\r\033[K"));
  std::this_thread::sleep_for(500ms);
  EXPECT_EQ(shown.text(), paused) << "nothing until somebody shows again";
  line.say("Note: a sentence");
  line.show("Return test", 0.4, 20.0);
  EXPECT_TRUE(shown.comes("Note: a sentence\n\r\033[KReturn test:  40 %"));
}

// Whenever the line is drawn, a message begins a line of its own.
TEST(ProgressLine, IsNotMixedWithMessagesOfTheLog) {
  ::testing::internal::CaptureStderr();
  {
    ProgressLine line({.out = stderr, .terminal = true, .quiet = 0ms});
    line.show("Solving", 0.25, 600.0);
    for (int i = 0; i < 20; ++i) {
      std::this_thread::sleep_for(40ms);
      log::info("test", "message " + std::to_string(i));
    }
  }
  const std::string shown = ::testing::internal::GetCapturedStderr();
  for (int i = 0; i < 20; ++i) {
    const std::size_t at = shown.find("message " + std::to_string(i) + "\n");
    ASSERT_NE(at, std::string::npos) << i;
    const std::string before = shown.substr(0, at);
    EXPECT_TRUE(before.empty() || before.ends_with("\n") || before.ends_with("\r\033[K")) << shown;
  }
  EXPECT_TRUE(shown.ends_with("\n") || shown.ends_with("\r\033[K")) << shown;
}

TEST(ProgressLine, IsHiddenWithTheMessagesOfItsLevel) {
  log::start({.quiet = true});
  ::testing::internal::CaptureStderr();
  for (const bool terminal : {false, true}) {
    ProgressLine line({.out = stderr, .terminal = terminal, .quiet = 0ms, .log_period = 10ms});
    line.show("Solving", 0.25, 600.0);
    line.say("Note: a sentence");
    std::this_thread::sleep_for(300ms);
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  log::start({});
}

// As users meet it: on a terminal and in a log.
TEST(ProgressLine, IsShownByACommandThatTakesLongerThanThreeSeconds) {
  const std::vector<std::string> command =
      forcegrid::testing::forcegrid_command({"doctor", "--seconds", "5"});
  InTerminal terminal(command);
  EXPECT_TRUE(terminal.wait_for("\r\033[Kmeasuring wake-ups idle:  "));
  EXPECT_TRUE(terminal.wait_for(" s left"));
  EXPECT_TRUE(terminal.wait_for("\r\033[K"));
  Program log(command);
  EXPECT_TRUE(log.wait_for_text(" s left\n"));
  EXPECT_THAT(log.standard_error(), Not(HasSubstr("\r")));
  EXPECT_THAT(log.standard_output(), Not(HasSubstr("left")));
}

}  // namespace
}  // namespace forcegrid::cli
