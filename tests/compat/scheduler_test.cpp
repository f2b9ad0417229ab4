// SPDX-License-Identifier: Apache-2.0
// The scheduler alone: its device is a clock.
#include "compat/openhaptics/scheduler.h"

#include <HD/hdDefines.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "compat/openhaptics/error_stack.h"

namespace forcegrid::openhaptics {
namespace {

using namespace std::chrono_literals;

class CountingClient : public TickClient {
 public:
  void tick_begins() noexcept override { ++ticks; }
  void callback_begins() noexcept override {}
  void callback_ended(bool recurring, rt::Duration /*took*/) noexcept override {
    (recurring ? recurring_callbacks : single_callbacks)++;
  }
  void tick_ended() noexcept override {}
  Wait wait_for_device(double /*rate_Hz*/, rt::TimePoint /*deadline*/) noexcept override {
    return Wait::kNoDevice;
  }
  std::atomic<int> ticks{0};
  std::atomic<int> recurring_callbacks{0};
  std::atomic<int> single_callbacks{0};
};

// A callback with a body; lives as long as the test.
struct Task {
  std::function<HDCallbackCode()> body;
  static HDCallbackCode run(void* self) { return static_cast<Task*>(self)->body(); }
};

class SchedulerTest : public ::testing::Test {
 protected:
  void TearDown() override { scheduler_.stop(); }
  HDSchedulerHandle add(std::function<HDCallbackCode()> body,
                        HDushort priority = HD_DEFAULT_SCHEDULER_PRIORITY) {
    return scheduler_.asynchronous(Task::run, keep(std::move(body)), priority);
  }
  void call(std::function<HDCallbackCode()> body,
            HDushort priority = HD_DEFAULT_SCHEDULER_PRIORITY) {
    scheduler_.synchronous(Task::run, keep(std::move(body)), priority);
  }
  void wait_for_ticks(int count) {
    const int until = client_.ticks + count;
    while (client_.ticks < until) {
      std::this_thread::sleep_for(200us);
    }
  }

  CountingClient client_;
  Scheduler scheduler_{client_};

 private:
  Task* keep(std::function<HDCallbackCode()> body) {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::make_unique<Task>(Task{std::move(body)}));
    return tasks_.back().get();
  }
  std::mutex mutex_;
  std::vector<std::unique_ptr<Task>> tasks_;
};

TEST_F(SchedulerTest, RunsInFallingPriorityAndEqualOnesInTheirOrder) {
  std::string order;
  add([&] {
    order += 'd';
    return HD_CALLBACK_DONE;
  });
  add(
      [&] {
        order += 'l';
        return HD_CALLBACK_DONE;
      },
      HD_MIN_SCHEDULER_PRIORITY);
  add(
      [&] {
        order += 'h';
        return HD_CALLBACK_DONE;
      },
      HD_MAX_SCHEDULER_PRIORITY);
  add([&] {
    order += 'e';
    return HD_CALLBACK_DONE;
  });
  ASSERT_TRUE(scheduler_.start());
  wait_for_ticks(2);
  scheduler_.stop();
  EXPECT_EQ(order, "hdel");
}

TEST_F(SchedulerTest, RunsWhatIsScheduledWhileItRunsFromTheNextTickOn) {
  std::atomic<int> tick_of_inner{-1};
  std::atomic<int> tick_of_outer{-1};
  add([&] {
    tick_of_outer = client_.ticks.load();
    add(
        [&] {
          tick_of_inner = client_.ticks.load();
          return HD_CALLBACK_DONE;
        },
        0);
    EXPECT_EQ(tick_of_inner, -1);
    return HD_CALLBACK_DONE;
  });
  scheduler_.start();
  wait_for_ticks(4);
  EXPECT_EQ(tick_of_inner, tick_of_outer + 1);
}

TEST_F(SchedulerTest, ADoneCallbackIsOverAndWaitingForItEnds) {
  std::atomic<int> runs{0};
  std::atomic<bool> go_on{true};
  scheduler_.start();
  const HDSchedulerHandle handle = add([&] {
    ++runs;
    return go_on ? HD_CALLBACK_CONTINUE : HD_CALLBACK_DONE;
  });
  wait_for_ticks(5);
  EXPECT_TRUE(scheduler_.is_scheduled(handle));
  go_on = false;
  scheduler_.wait_for(handle);
  EXPECT_FALSE(scheduler_.is_scheduled(handle));
  const int at_end = runs;
  EXPECT_GE(at_end, 2);
  wait_for_ticks(5);
  EXPECT_EQ(runs, at_end);
  EXPECT_EQ(client_.recurring_callbacks, at_end);  // its last run, too
}

TEST_F(SchedulerTest, ASynchronousCallRunsOnceFromAnywhere) {
  int runs = 0;
  call([&] {
    ++runs;
    return HD_CALLBACK_CONTINUE;
  });  // without a servo thread: here
  EXPECT_EQ(runs, 1);
  scheduler_.start();
  call([&] {
    EXPECT_TRUE(Scheduler::in_servo_thread());
    ++runs;
    call([&] {
      ++runs;
      return HD_CALLBACK_DONE;
    });  // in the servo thread: at once
    EXPECT_EQ(runs, 3);
    return HD_CALLBACK_CONTINUE;
  });
  EXPECT_EQ(runs, 3);
  int unguarded = 0;  // by callbacks alone, which never run at the same time
  std::vector<std::thread> threads;
  for (int i = 0; i < 10; ++i) {
    threads.emplace_back([&] {
      for (int j = 0; j < 20; ++j) {
        call([&] {
          ++unguarded;
          return HD_CALLBACK_DONE;
        });
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(unguarded, 200);
  EXPECT_EQ(client_.recurring_callbacks, 0);
}

TEST_F(SchedulerTest, TenThreadsCallAtOnceWithoutAServoThread) {
  int unguarded = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 10; ++i) {
    threads.emplace_back([&] {
      call([&] {
        ++unguarded;
        return HD_CALLBACK_DONE;
      });
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(unguarded, 10);
}

TEST_F(SchedulerTest, UnscheduledMeansNotRunningAnyMore) {
  scheduler_.start();
  std::atomic<bool> inside{false};
  const HDSchedulerHandle handle = add([&] {
    inside = true;
    std::this_thread::sleep_for(20ms);
    inside = false;
    return HD_CALLBACK_CONTINUE;
  });
  while (!inside) {
    std::this_thread::sleep_for(100us);
  }
  EXPECT_TRUE(scheduler_.unschedule(handle));
  EXPECT_FALSE(inside);
  EXPECT_TRUE(scheduler_.unschedule(handle));
  EXPECT_TRUE(scheduler_.unschedule(0));
  EXPECT_TRUE(scheduler_.unschedule(HD_INVALID_HANDLE));
  EXPECT_FALSE(scheduler_.is_scheduled(HD_INVALID_HANDLE));
}

TEST_F(SchedulerTest, ACallbackMayUnscheduleItself) {
  std::atomic<int> runs{0};
  std::atomic<HDSchedulerHandle> own{0};
  own = add([&] {
    ++runs;
    scheduler_.unschedule(own);
    return HD_CALLBACK_CONTINUE;
  });
  scheduler_.start();
  wait_for_ticks(5);
  EXPECT_EQ(runs, 1);
}

TEST_F(SchedulerTest, KeepsItsEntriesFromStopToStart) {
  std::atomic<int> runs{0};
  add([&] {
    ++runs;
    return HD_CALLBACK_CONTINUE;
  });
  scheduler_.start();
  scheduler_.start();
  wait_for_ticks(3);
  EXPECT_TRUE(scheduler_.stop());
  const int stopped = runs;
  EXPECT_GE(stopped, 3);
  std::this_thread::sleep_for(5ms);
  EXPECT_EQ(runs, stopped);
  EXPECT_TRUE(scheduler_.stop());
  scheduler_.start();
  wait_for_ticks(3);
  EXPECT_GT(runs, stopped);
}

TEST_F(SchedulerTest, ACallbackMayStopItAndStartItAgain) {
  std::atomic<int> runs{0};
  add([&] {
    if (++runs == 3) {
      scheduler_.stop();
    }
    return HD_CALLBACK_CONTINUE;
  });
  scheduler_.start();
  while (scheduler_.running()) {
    std::this_thread::sleep_for(100us);
  }
  EXPECT_TRUE(scheduler_.stop());
  EXPECT_EQ(runs, 3);
  call([&] {
    ++runs;
    return HD_CALLBACK_DONE;
  });
  EXPECT_EQ(runs, 4);
  runs = 10;
  add([&] {
    scheduler_.stop();
    scheduler_.start();
    return HD_CALLBACK_DONE;
  });
  scheduler_.start();
  wait_for_ticks(5);
  EXPECT_GE(runs, 14);
}

TEST_F(SchedulerTest, AWaitingCallerIsServedWhenItStops) {
  scheduler_.start();
  std::atomic<bool> blocks{true};
  add(
      [&] {
        while (blocks) {
          std::this_thread::sleep_for(1ms);
        }
        return HD_CALLBACK_DONE;
      },
      HD_MAX_SCHEDULER_PRIORITY);
  wait_for_ticks(0);
  std::atomic<bool> served{false};
  std::thread caller([&] {
    call([&] {
      served = true;
      return HD_CALLBACK_DONE;
    });
  });
  std::this_thread::sleep_for(20ms);
  EXPECT_FALSE(scheduler_.stop(10ms));  // the callback does not return
  caller.join();
  EXPECT_TRUE(served);
  blocks = false;
  EXPECT_TRUE(scheduler_.stop());
}

TEST_F(SchedulerTest, WhatThrowsIsDoneAndTheOthersRun) {
  std::atomic<int> runs{0};
  std::atomic<int> thrown{0};
  std::atomic<HDerror> error{0};
  add(
      [&]() -> HDCallbackCode {
        ++thrown;
        throw std::runtime_error("as a test wants");
      },
      100);
  add(
      [&]() -> HDCallbackCode {
        ++thrown;
        throw 3;
      },
      100);
  add(
      [&] {
        if (++runs == 1) {
          error = errors_of_this_thread().pop().errorCode;
        }
        return HD_CALLBACK_CONTINUE;
      },
      50);
  scheduler_.start();
  wait_for_ticks(5);
  EXPECT_EQ(thrown, 2);
  EXPECT_GE(runs, 4);
  EXPECT_EQ(error, static_cast<HDerror>(HD_INVALID_OPERATION));
}

TEST_F(SchedulerTest, ACallbackMaySchedule1000Others) {
  std::atomic<int> runs{0};
  add([&] {
    for (int i = 0; i < 1000; ++i) {
      EXPECT_NE(add(
                    [&] {
                      ++runs;
                      return HD_CALLBACK_DONE;
                    },
                    static_cast<HDushort>(i)),
                0U);
    }
    return HD_CALLBACK_DONE;
  });
  scheduler_.start();
  wait_for_ticks(4);
  EXPECT_EQ(runs, 1000);
}

TEST_F(SchedulerTest, SaysWhenItIsFull) {
  for (std::size_t i = 0; i < Scheduler::kMaxEntries; ++i) {
    ASSERT_NE(scheduler_.asynchronous(Task::run, nullptr, 0), 0U);
  }
  EXPECT_EQ(scheduler_.asynchronous(Task::run, nullptr, 0), 0U);
}

TEST_F(SchedulerTest, KeepsItsRateOnAverageAndMeasuresIt) {
  EXPECT_EQ(scheduler_.measured_rate_Hz(), 1000.0);
  EXPECT_EQ(scheduler_.seconds_in_tick(), 0.0);
  for (const double wrong_Hz : {0.0, 1.0, 499.0, 4001.0, 1e9, -1000.0}) {
    EXPECT_FALSE(scheduler_.set_rate(wrong_Hz)) << wrong_Hz;
  }
  for (const double rate_Hz : {500.0, 2000.0}) {
    ASSERT_TRUE(scheduler_.set_rate(rate_Hz));
    std::atomic<double> longest_s{0.0};
    const HDSchedulerHandle handle = add([&] {
      longest_s = std::max(longest_s.load(), scheduler_.seconds_in_tick());
      return HD_CALLBACK_CONTINUE;
    });
    scheduler_.start();
    const rt::TimePoint began = rt::Clock::now();
    const int before = client_.ticks;
    std::this_thread::sleep_for(500ms);
    const double ticks_per_s = (client_.ticks - before) / rt::seconds(rt::Clock::now() - began);
    EXPECT_NEAR(ticks_per_s, rate_Hz, 0.1 * rate_Hz);
    EXPECT_NEAR(scheduler_.measured_rate_Hz(), rate_Hz, 0.1 * rate_Hz);
    scheduler_.stop();
    EXPECT_GT(longest_s, 0.0);
    EXPECT_LT(longest_s, 0.1);
    scheduler_.unschedule(handle);
  }
}

// As Python does to a thread that wants to run it after its end.
TEST_F(SchedulerTest, SurvivesACallbackThatEndsItsThread) {
  add([]() -> HDCallbackCode { pthread_exit(nullptr); });
  scheduler_.start();
  while (scheduler_.running()) {
    std::this_thread::sleep_for(100us);
  }
  EXPECT_TRUE(scheduler_.stop());
  std::atomic<int> runs{0};
  add([&] {
    ++runs;
    return HD_CALLBACK_CONTINUE;
  });
  scheduler_.start();
  wait_for_ticks(3);
  EXPECT_GE(runs, 2);
}

}  // namespace
}  // namespace forcegrid::openhaptics
