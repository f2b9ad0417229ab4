// SPDX-License-Identifier: Apache-2.0
#include "rt/parallel_jobs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>

#include "rt/clock.h"

namespace forcegrid::rt {
namespace {

using std::chrono::milliseconds;

constexpr double kSoon_s = 2.0;  // a loaded machine wakes a thread late

std::ptrdiff_t threads_of_this_process() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/task"), {});
}

// The kernel may list a thread for a moment after it was joined.
std::ptrdiff_t threads_left(std::ptrdiff_t before) {
  for (int wait = 0; wait < 1000 && threads_of_this_process() > before; ++wait) {
    std::this_thread::sleep_for(milliseconds(1));
  }
  return threads_of_this_process() - before;
}

// A job that would never end by itself.
bool until_stopped(const Job& job) {
  while (!job.stopping()) {
    std::this_thread::sleep_for(milliseconds(1));
  }
  return false;
}

TEST(ParallelJobs, RunsEveryJobOnceOnNoMoreThreadsThanAskedFor) {
  constexpr std::size_t kCount = 100;
  std::vector<std::atomic<int>> runs(kCount);
  std::mutex mutex;
  std::set<std::thread::id> threads;
  EXPECT_TRUE(run_jobs(kCount, {.threads = 3}, [&](Job& job) {
    ++runs[job.number()];
    const std::lock_guard lock(mutex);
    threads.insert(std::this_thread::get_id());
    return true;
  }));
  EXPECT_TRUE(std::all_of(runs.begin(), runs.end(), [](const auto& count) { return count == 1; }));
  EXPECT_THAT(threads.size(), testing::AllOf(testing::Ge(1U), testing::Le(3U)));
  EXPECT_EQ(threads.count(std::this_thread::get_id()), 0U) << "the caller only waits";
}

TEST(ParallelJobs, NoJobIsFinishedAtOnceAndReportsNothing) {
  JobOptions options;
  options.progress = [](double, double) { FAIL() << "there is nothing to report"; };
  EXPECT_TRUE(run_jobs(0, options, [](Job&) -> bool { throw std::logic_error("there is none"); }));
}

TEST(ParallelJobs, ProgressNeverFallsAndEndsWithOne) {
  std::vector<double> seen;
  JobOptions options{.threads = 2, .period = milliseconds(1)};
  options.first_guess_s = 7.0;
  options.progress = [&seen](double done, double remaining_s) {
    EXPECT_GE(done, seen.empty() ? 0.0 : seen.back());
    EXPECT_LE(done, 1.0);
    EXPECT_GE(remaining_s, 0.0);
    seen.push_back(done);
  };
  EXPECT_TRUE(run_jobs(4, options, [](Job& job) {
    for (const double done : {0.25, 0.5, 0.1, 0.75}) {  // the third one would be a step back
      job.report(done);
      std::this_thread::sleep_for(milliseconds(5));
    }
    return true;
  }));
  ASSERT_GT(seen.size(), 3U);
  EXPECT_EQ(seen.back(), 1.0);
}

TEST(ParallelJobs, WeightsSayHowMuchEachJobCounts) {
  std::atomic<bool> asked{false};
  double half_way = -1.0;
  JobOptions options{.threads = 2, .weights = {3.0, 1.0}, .period = milliseconds(1)};
  std::atomic<int> reported{0};
  options.progress = [&](double done, double) {
    if (reported == 2 && half_way < 0.0) {
      half_way = done;
      asked = true;
    }
  };
  EXPECT_TRUE(run_jobs(2, options, [&](Job& job) {
    job.report(job.number() == 0 ? 0.5 : 0.25);
    ++reported;
    while (!asked) {
      std::this_thread::sleep_for(milliseconds(1));
    }
    return true;
  }));
  EXPECT_DOUBLE_EQ(half_way, (3.0 * 0.5 + 1.0 * 0.25) / 4.0);
}

TEST(ParallelJobs, CancelStopsTheRunningJobsSoonAndBeginsNoFurtherOne) {
  std::atomic<bool> cancel{false};
  std::atomic<int> begun{0};
  JobOptions options{.threads = 2};
  options.cancel = &cancel;
  const TimePoint start = Clock::now();
  EXPECT_FALSE(run_jobs(1000, options, [&](Job& job) {
    if (++begun == 2) {
      cancel = true;
    }
    return until_stopped(job);
  }));
  EXPECT_LT(seconds(Clock::now() - start), kSoon_s);
  EXPECT_EQ(begun, 2);
}

TEST(ParallelJobs, TheStopFlagFollowsCancelForWorkInsideAJob) {
  std::atomic<bool> cancel{false};
  JobOptions options{.threads = 1, .period = milliseconds(1)};
  options.cancel = &cancel;
  const TimePoint start = Clock::now();
  EXPECT_FALSE(run_jobs(1, options, [&](Job& job) {
    cancel = true;
    while (!job.stop_flag()) {
      std::this_thread::sleep_for(milliseconds(1));
    }
    return false;
  }));
  EXPECT_LT(seconds(Clock::now() - start), kSoon_s);
}

TEST(ParallelJobs, ACancelAfterTheLastJobChangesNothing) {
  std::atomic<bool> cancel{false};
  JobOptions options{.threads = 1};
  options.cancel = &cancel;
  EXPECT_TRUE(run_jobs(1, options, [&](Job&) {
    cancel = true;
    return true;
  }));
}

TEST(ParallelJobs, TheFirstExceptionStopsTheOthersAndIsRethrown) {
  std::atomic<bool> second_runs{false};
  try {
    run_jobs(10, {.threads = 2}, [&](Job& job) -> bool {
      if (job.number() == 1) {
        second_runs = true;
        until_stopped(job);
        throw std::runtime_error("the second one");
      }
      while (!second_runs) {
        std::this_thread::sleep_for(milliseconds(1));
      }
      throw std::runtime_error("the first one");
    });
    FAIL() << "an exception was lost";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "the first one");
  }
}

TEST(ParallelJobs, NoThreadOutlivesTheCallHoweverItEnds) {
  const std::ptrdiff_t before = threads_of_this_process();
  std::atomic<bool> cancel{true};
  JobOptions cancelled{.threads = 4};
  cancelled.cancel = &cancel;
  EXPECT_FALSE(run_jobs(8, cancelled, until_stopped));
  EXPECT_EQ(threads_left(before), 0);
  EXPECT_THROW(run_jobs(8, {.threads = 4}, [](Job&) -> bool { throw std::logic_error("job"); }),
               std::logic_error);
  EXPECT_EQ(threads_left(before), 0);
  JobOptions careless{.threads = 4, .period = milliseconds(1)};
  careless.progress = [](double, double) { throw std::logic_error("progress"); };
  EXPECT_THROW(run_jobs(8, careless, until_stopped), std::logic_error);
  EXPECT_EQ(threads_left(before), 0);
}

}  // namespace
}  // namespace forcegrid::rt
