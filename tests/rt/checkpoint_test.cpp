// SPDX-License-Identifier: Apache-2.0
#include "rt/checkpoint.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <optional>
#include <thread>

#include "rt/parallel_jobs.h"

namespace forcegrid::rt {
namespace {

using std::chrono::milliseconds;

TEST(Checkpoint, InterruptsOnlyASupervisedThreadThatIsToStop) {
  std::atomic<bool> stop{false};
  checkpoint();
  const Supervised supervised({.stop = &stop});
  checkpoint();
  stop = true;
  EXPECT_THROW(checkpoint(), Interrupted);
  bool other_went_on = false;
  std::thread([&other_went_on] {
    checkpoint();
    other_went_on = true;
  }).join();
  EXPECT_TRUE(other_went_on);
  {
    const Supervised nobody({});
    checkpoint();  // the inner supervision counts
  }
  EXPECT_THROW(checkpoint(), Interrupted);
}

TEST(Checkpoint, TellsNowAndThenThatTheWorkGoesOn) {
  int told = 0;
  const Supervised supervised(
      {.alive = [&told](std::optional<double>) { ++told; }, .period = milliseconds(20)});
  checkpoint();
  EXPECT_EQ(told, 0) << "the period is not over";
  std::this_thread::sleep_for(milliseconds(25));
  checkpoint();
  checkpoint();
  EXPECT_EQ(told, 1);
  std::this_thread::sleep_for(milliseconds(25));
  note_progress();
  EXPECT_EQ(told, 2);
}

TEST(Checkpoint, TellsWhatShareOfThePartsOfTheWorkIsDone) {
  std::optional<double> told;
  const Supervised supervised(
      {.alive = [&told](std::optional<double> done) { told = done; }, .period = milliseconds(0)});
  checkpoint();
  EXPECT_FALSE(told.has_value());
  {
    const PartOfWork first(0.0, 0.5);
    checkpoint(1, 4);
    EXPECT_DOUBLE_EQ(told.value_or(-1.0), 0.125);
    {
      const PartOfWork within(0.5, 0.75);  // 0.25 to 0.375 of the whole
      checkpoint(1, 2);
      EXPECT_DOUBLE_EQ(told.value_or(-1.0), 0.3125);
    }
    checkpoint();
    EXPECT_DOUBLE_EQ(told.value_or(-1.0), 0.375) << "the part within has ended";
  }
  note_progress(1, 2);
  EXPECT_DOUBLE_EQ(told.value_or(-1.0), 0.5) << "of the whole again";
  checkpoint(0, 0);
  EXPECT_DOUBLE_EQ(told.value_or(-1.0), 0.5);
}

TEST(Checkpoint, EndsParallelJobsOfASupervisedThread) {
  std::atomic<bool> stop{false};
  const Supervised supervised({.stop = &stop});
  std::atomic<int> begun{0};
  std::thread asks([&] {
    while (begun < 2) {
      std::this_thread::sleep_for(milliseconds(1));
    }
    stop = true;
  });
  const bool finished = run_jobs(8, {.threads = 2}, [&begun](Job&) {
    ++begun;
    for (;;) {  // would never end by itself
      checkpoint();
      std::this_thread::sleep_for(milliseconds(1));
    }
    return true;
  });
  asks.join();
  EXPECT_FALSE(finished);
  EXPECT_EQ(begun, 2) << "no other job begins";
}

}  // namespace
}  // namespace forcegrid::rt
