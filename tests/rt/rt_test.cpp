// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "rt/mailbox.h"
#include "rt/percentiles.h"
#include "rt/processors_awake.h"
#include "rt/spsc_ring.h"
#include "rt/thread.h"

namespace forcegrid::rt {
namespace {

TEST(Mailbox, HandsOverTheNewestValueOnce) {
  Mailbox<int> mailbox;
  int value = -1;
  EXPECT_FALSE(mailbox.fetch(value));
  mailbox.publish(1);
  mailbox.publish(2);
  ASSERT_TRUE(mailbox.fetch(value));
  EXPECT_EQ(value, 2);
  EXPECT_FALSE(mailbox.fetch(value));
}

TEST(Mailbox, NeverTearsAValueBetweenThreads) {
  struct Pair {
    long first = 0;
    long padding[15] = {};
    long second = 0;
  };
  Mailbox<Pair> mailbox;
  constexpr long kLast = 200000;
  std::thread writer([&] {
    for (long i = 1; i <= kLast; ++i) {
      Pair pair;
      pair.first = pair.second = i;
      mailbox.publish(pair);
    }
  });
  long newest = 0;
  while (newest < kLast) {
    Pair pair;
    if (!mailbox.fetch(pair)) {
      std::this_thread::yield();
      continue;
    }
    ASSERT_EQ(pair.first, pair.second);
    ASSERT_GT(pair.first, newest);
    newest = pair.first;
  }
  writer.join();
}

TEST(SpscRing, RefusesWhenFullAndKeepsOrder) {
  SpscRing<int> ring(3);
  EXPECT_TRUE(ring.push(1));
  EXPECT_TRUE(ring.push(2));
  EXPECT_TRUE(ring.push(3));
  EXPECT_FALSE(ring.push(4));
  int value = 0;
  for (int expected = 1; expected <= 3; ++expected) {
    ASSERT_TRUE(ring.pop(value));
    EXPECT_EQ(value, expected);
  }
  EXPECT_FALSE(ring.pop(value));
}

TEST(SpscRing, LosesNothingBetweenThreads) {
  SpscRing<int> ring(7);
  constexpr int kLast = 100000;
  std::thread producer([&] {
    for (int i = 1; i <= kLast;) {
      if (ring.push(i)) {
        ++i;
      } else {
        std::this_thread::yield();
      }
    }
  });
  int expected = 1;
  while (expected <= kLast) {
    int value = 0;
    if (ring.pop(value)) {
      ASSERT_EQ(value, expected++);
    } else {
      std::this_thread::yield();
    }
  }
  producer.join();
}

TEST(ProcessorsAwake, AsksForNoLatencyUntilItIsGone) {
  const std::string file = ::testing::TempDir() + "latency_" + std::to_string(getpid());
  std::ofstream(file).close();
  {
    const ProcessorsAwake awake(file.c_str());
    EXPECT_TRUE(awake.held());
    EXPECT_EQ(awake.refused(), "");
    std::ifstream stream(file, std::ios::binary);
    std::int32_t asked_us = -1;
    stream.read(reinterpret_cast<char*>(&asked_us), sizeof asked_us);
    EXPECT_EQ(asked_us, 0);
  }
  std::remove(file.c_str());
}

TEST(ProcessorsAwake, SaysWhyItIsRefusedButNotWhereTheKernelTakesNoRequest) {
  const ProcessorsAwake refused(::testing::TempDir().c_str());  // a folder
  EXPECT_FALSE(refused.held());
  EXPECT_NE(refused.refused().find("Is a directory"), std::string::npos) << refused.refused();
  EXPECT_NE(refused.refused().find("; run as root"), std::string::npos) << refused.refused();
  const ProcessorsAwake none("/no/such/file");
  EXPECT_FALSE(none.held());
  EXPECT_EQ(none.refused(), "");
}

TEST(Percentiles, AgreeWithASortedListWithinOneBin) {
  constexpr unsigned kSeed = 20260101;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  std::lognormal_distribution<double> distribution(3.0, 2.0);
  Percentiles percentiles;
  std::vector<double> values;
  for (int i = 0; i < 20000; ++i) {
    values.push_back(distribution(random));
    percentiles.add(values.back());
  }
  std::sort(values.begin(), values.end());
  for (double p : {0.5, 0.99, 0.999}) {
    const double exact = values[static_cast<std::size_t>(p * 20000) - 1];
    EXPECT_NEAR(percentiles.at(p) / exact, 1.0, 1.0 / 512) << p;
  }
  EXPECT_EQ(percentiles.max(), values.back());
  EXPECT_EQ(percentiles.min(), values.front());
}

TEST(Percentiles, CountHowManyAreAtMostAValue) {
  Percentiles percentiles;
  for (const double value : {0.0, 3.0, 3.0, 50.0, 700.0}) {
    percentiles.add(value);
  }
  EXPECT_EQ(percentiles.count_up_to(-1.0), 0u);
  EXPECT_EQ(percentiles.count_up_to(0.0), 1u);
  EXPECT_EQ(percentiles.count_up_to(2.9), 1u);
  EXPECT_EQ(percentiles.count_up_to(3.0), 3u);
  EXPECT_EQ(percentiles.count_up_to(50.0), 4u);
  EXPECT_EQ(percentiles.count_up_to(699.0), 4u);
  EXPECT_EQ(percentiles.count_up_to(std::numeric_limits<double>::infinity()), 5u);
  EXPECT_EQ(Percentiles().count_up_to(1.0), 0u);
}

TEST(Percentiles, CountBadValuesApart) {
  Percentiles percentiles;
  percentiles.add(-1.0);
  percentiles.add(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(percentiles.count(), 0u);
  EXPECT_EQ(percentiles.ignored(), 2u);
  EXPECT_EQ(percentiles.at(0.5), 0.0);
}

TEST(Scheduling, SaysWhatItGotAndWhyNot) {
  std::thread([] {
    const Scheduling scheduling = make_current_thread_realtime(1);
    EXPECT_EQ(scheduling.realtime, scheduling.reason.empty());
    EXPECT_EQ(scheduling.priority, scheduling.realtime ? 1 : 0);
    EXPECT_FALSE(make_current_thread_realtime(1000).realtime);
  }).join();
}

TEST(SleepUntil, ReturnsAtOnceForThePastAndNotBeforeTheFuture) {
  sleep_until(Clock::now() - std::chrono::seconds(1));
  const TimePoint deadline = Clock::now() + std::chrono::milliseconds(5);
  sleep_until(deadline);
  EXPECT_GE(Clock::now(), deadline);
}

}  // namespace
}  // namespace forcegrid::rt
