// `forcegrid run --live` in a pseudo-terminal of 80 x 24, and out of it on every way.

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <vector>

#include "tests/integration/program.h"

namespace forcegrid {
namespace {

using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

constexpr char kEnter[] = "\x1b[?1049h";
constexpr char kLeave[] = "\x1b[?1049l";
constexpr char kShowCursor[] = "\x1b[?25h";

// The command in a terminal of its own.
class InTerminal {
 public:
  explicit InTerminal(std::vector<std::string> arguments) {
    winsize size{};
    size.ws_col = 80;
    size.ws_row = 24;
    pid_ = forkpty(&terminal_, nullptr, nullptr, &size);
    if (pid_ == 0) {
      setenv("TERM", "xterm", 1);
      arguments = testing::forcegrid_command(arguments);
      std::vector<char*> argv;
      for (std::string& argument : arguments) {
        argv.push_back(argument.data());
      }
      argv.push_back(nullptr);
      execv(argv[0], argv.data());
      _exit(127);
    }
  }
  ~InTerminal() {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
    close(terminal_);
  }
  InTerminal(const InTerminal&) = delete;
  InTerminal& operator=(const InTerminal&) = delete;

  // Reads until `text` has come, the program has ended, or 30 s.
  bool wait_for(const std::string& text) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while (seen_.find(text, from_) == std::string::npos) {
      pollfd entry{terminal_, POLLIN, 0};
      if (std::chrono::steady_clock::now() > deadline || poll(&entry, 1, 1000) < 0) {
        return false;
      }
      char buffer[4096];
      const ssize_t count = entry.revents != 0 ? read(terminal_, buffer, sizeof buffer) : 0;
      if (count < 0) {
        return seen_.find(text, from_) != std::string::npos;  // EIO: the other end is closed
      }
      seen_.append(buffer, static_cast<std::size_t>(count));
    }
    return true;
  }
  void forget() { from_ = seen_.size(); }
  void send_signal(int number) const { kill(pid_, number); }
  bool wait_until_stopped() const {
    int status = 0;
    return waitpid(pid_, &status, WUNTRACED) == pid_ && WIFSTOPPED(status);
  }
  const std::string& seen() const { return seen_; }
  // All that it still says, to its end. @returns whether the terminal was given back at last.
  bool gave_the_terminal_back() {
    wait_for("\x1b never \x1b");
    return seen_.rfind(kLeave) != std::string::npos && seen_.rfind(kLeave) > seen_.rfind(kEnter) &&
           seen_.rfind(kShowCursor) > seen_.rfind("\x1b[?25l");
  }

 private:
  pid_t pid_ = -1;
  int terminal_ = -1;
  std::string seen_;
  std::size_t from_ = 0;
};

std::vector<std::string> live_run(const std::string& seconds) {
  return {"run",        "--live", "--scene",           "small", "--seconds", seconds,
          "--no-truth", "--out",  fresh_folder("live")};
}

TEST(Live, DrawsTheLoopAndGivesTheTerminalBackAtTheEnd) {
  InTerminal run(live_run("5"));
  ASSERT_TRUE(run.wait_for(kEnter)) << run.seen();
  ASSERT_TRUE(run.wait_for("of 500 cycles/s")) << run.seen();
  EXPECT_TRUE(run.gave_the_terminal_back());
  EXPECT_THAT(run.seen().substr(run.seen().rfind(kLeave)), HasSubstr("Wrote"));  // the summary
}

TEST(Live, ShowsTheSentencesOfTheLoopAndPrintsThemAtTheEnd) {
  InTerminal run(live_run("60"));
  ASSERT_TRUE(run.wait_for("s  Samples come; the force ramps in.")) << run.seen();
  EXPECT_EQ(run.seen().rfind(kLeave), std::string::npos) << "it is shown in the picture";
  run.send_signal(SIGINT);
  EXPECT_TRUE(run.gave_the_terminal_back());
  EXPECT_THAT(run.seen().substr(run.seen().rfind(kLeave)),
              HasSubstr("s  Samples come; the force ramps in."));
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
  EXPECT_TRUE(run.wait_for(kLeave));
  ASSERT_TRUE(run.wait_until_stopped());
  run.forget();
  run.send_signal(SIGCONT);
  EXPECT_TRUE(run.wait_for(kEnter));
}

TEST(Live, IsRefusedWithoutATerminal) {
  Program run = Program::forcegrid({"run", "--live", "--seconds", "1"});
  EXPECT_EQ(run.wait(std::chrono::seconds(20)), 1);
  EXPECT_THAT(run.standard_error(), HasSubstr("ssh -t"));
}

}  // namespace
}  // namespace forcegrid
