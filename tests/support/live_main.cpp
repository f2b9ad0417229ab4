// SPDX-License-Identifier: Apache-2.0
// main() of the tests that drive devices, or processes, in real time.
//
// What they prove holds on a machine that gives them its cores when they are due. A shared machine
// may stand still for a tenth of a second, and a device is then rightly taken for dead. So each
// core is watched while the test runs, in another process: a failure counts unless a core did stand
// still; then the test is run again, says so, and may fail three times at most.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string_view>
#include <thread>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kAttempts = 3;
constexpr milliseconds kTick{1};
constexpr milliseconds kStandstill{15};
constexpr const char* kWatched = "FORCEGRID_TEST_IS_WATCHED";

// The longest that a thread of usual priority waited for a core since the last look.
class CoreWatch {
 public:
  explicit CoreWatch(int core) : thread_([this, core] { watch(core); }) {}
  ~CoreWatch() {
    end_ = true;
    thread_.join();
  }
  milliseconds longest() const { return milliseconds(longest_ms_.load()); }

 private:
  void watch(int core) {
    cpu_set_t only;
    CPU_ZERO(&only);
    CPU_SET(core, &only);
    sched_setaffinity(0, sizeof only, &only);
    for (auto last = Clock::now(); !end_;) {
      std::this_thread::sleep_for(kTick);
      const auto now = Clock::now();
      const auto late_ms = std::chrono::duration_cast<milliseconds>(now - last - kTick).count();
      longest_ms_ = std::max<std::int64_t>(longest_ms_, late_ms);
      last = now;
    }
  }

  std::atomic<bool> end_{false};
  std::atomic<std::int64_t> longest_ms_{0};
  std::thread thread_;
};

// The cores on which this process may run.
std::vector<std::unique_ptr<CoreWatch>> watch_cores() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  sched_getaffinity(0, sizeof allowed, &allowed);
  std::vector<std::unique_ptr<CoreWatch>> watches;
  for (int core = 0; core < CPU_SETSIZE; ++core) {
    if (CPU_ISSET(core, &allowed)) {
      watches.push_back(std::make_unique<CoreWatch>(core));
    }
  }
  return watches;
}

struct Attempt {
  int status = 1;  // as of a shell
  milliseconds standstill{0};
};

Attempt attempt(char** argv) {
  // Forked while there is no other thread.
  const pid_t child = fork();
  if (child < 0) {
    std::perror("fork");
    return {};
  }
  if (child == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    setenv(kWatched, "1", 1);
    execv("/proc/self/exe", argv);
    std::perror("/proc/self/exe");
    _exit(127);
  }
  const auto watches = watch_cores();
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  Attempt result{WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status)};
  for (const auto& watch : watches) {
    result.standstill = std::max(result.standstill, watch->longest());
  }
  return result;
}

int run_watched(char** argv) {
  for (int number = 1;; ++number) {
    const Attempt one = attempt(argv);
    const bool excused = one.standstill > kStandstill;
    if (one.status == 0 || number == kAttempts || !excused) {
      if (one.status != 0) {
        std::printf("It failed; a core stood still for %lld ms at most.\n",
                    static_cast<long long>(one.standstill.count()));
      }
      return one.status;
    }
    std::printf("AGAIN: it failed while a core stood still for %lld ms; attempt %d of %d.\n",
                static_cast<long long>(one.standstill.count()), number + 1, kAttempts);
    std::fflush(stdout);
  }
}

bool is_question(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    if (std::string_view(argv[i]).starts_with("--gtest_list_tests")) {
      return true;
    }
  }
  return false;
}

}  // namespace

int main(int argc, char** argv) {
  if (std::getenv(kWatched) == nullptr && !is_question(argc, argv)) {
    return run_watched(argv);
  }
  unsetenv(kWatched);
  ::testing::InitGoogleMock(&argc, argv);
  return RUN_ALL_TESTS();
}
