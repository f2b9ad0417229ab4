// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/watched_run.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>

#include "tests/servo_loop/loop_bench.h"

namespace forcegrid::servo {
namespace {

// In real time, since run() waits for its deadlines. The device's one report lasts for the test.
class WatchedRun : public LoopBench {
 protected:
  static ServoOptions patient() {
    ServoOptions options = LoopBench::options();
    options.report_timeout = std::chrono::seconds(60);
    return options;
  }
  WatchedRun() : LoopBench(patient()) { device_.show(Eigen::Vector3d::Zero(), rt::Clock::now()); }

  std::atomic<bool> stop_{false};
};

TEST_F(WatchedRun, EndsAtZeroCurrentWhenTheWatchingThreadThrows) {
  std::string said;
  bool stopped_before_the_catch = false;
  try {
    run_watched(
        loop_, stop_, 0.0, [this] { stop_ = true; },
        [] {
          std::this_thread::sleep_for(std::chrono::milliseconds(20));
          throw std::runtime_error("the terminal is gone");
        });
  } catch (const std::runtime_error& error) {
    said = error.what();
    stopped_before_the_catch = device_.stopped;
  }
  EXPECT_EQ(said, "the terminal is gone");
  EXPECT_TRUE(stopped_before_the_catch);  // the loop's last step: the device was told zero
}

TEST_F(WatchedRun, WatchesUntilTheLoopHasEndedByItself) {
  int watched = 0;
  const ServoOutcome outcome = run_watched(
      loop_, stop_, 0.1, [this] { stop_ = true; },
      [&] {
        ++watched;
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      });
  EXPECT_EQ(outcome.fault, Fault::kNone);
  EXPECT_TRUE(outcome.zero_current_delivered);
  EXPECT_GT(outcome.cycles, 0u);
  EXPECT_GT(watched, 1);
  EXPECT_FALSE(stop_);
}

}  // namespace
}  // namespace forcegrid::servo
