// SPDX-License-Identifier: Apache-2.0
#include "link/sequence_tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

namespace forcegrid::link {
namespace {

using Arrival = SequenceTracker::Arrival;

TEST(SequenceTracker, CountsAGapUntilItIsFilled) {
  SequenceTracker tracker;
  EXPECT_EQ(tracker.observe(10), Arrival::kNewest);
  EXPECT_EQ(tracker.observe(14), Arrival::kNewest);
  EXPECT_EQ(tracker.missing(), 3U);
  EXPECT_EQ(tracker.observe(12), Arrival::kReordered);
  EXPECT_EQ(tracker.observe(12), Arrival::kDuplicated);
  EXPECT_EQ(tracker.missing(), 2U);
}

TEST(SequenceTracker, NumbersBeforeTheFirstWereNotMissed) {
  SequenceTracker tracker;
  tracker.observe(10);
  tracker.observe(12);
  EXPECT_EQ(tracker.observe(9), Arrival::kReordered);
  EXPECT_EQ(tracker.missing(), 1U);
}

TEST(SequenceTracker, GoesOnAcrossTheWrapOfItsNumbers) {
  SequenceTracker tracker;
  EXPECT_EQ(tracker.observe(0xFFFFFFFE), Arrival::kNewest);
  EXPECT_EQ(tracker.observe(1), Arrival::kNewest);
  EXPECT_EQ(tracker.missing(), 2U);
  EXPECT_EQ(tracker.observe(0xFFFFFFFF), Arrival::kReordered);
  EXPECT_EQ(tracker.observe(0), Arrival::kReordered);
  EXPECT_EQ(tracker.missing(), 0U);
}

TEST(SequenceTracker, CannotTellBeyondItsWindow) {
  SequenceTracker tracker;
  tracker.observe(0);
  tracker.observe(1024);
  EXPECT_EQ(tracker.observe(1), Arrival::kReordered);
  EXPECT_EQ(tracker.observe(0), Arrival::kTooOld);
  EXPECT_EQ(tracker.observe(5000), Arrival::kNewest);
  EXPECT_EQ(tracker.observe(4999), Arrival::kReordered);
  EXPECT_EQ(tracker.observe(1024), Arrival::kTooOld);
}

TEST(SequenceTracker, AgreesWithACountOfShuffledNumbers) {
  constexpr std::uint32_t kSeed = 7;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  std::vector<std::uint32_t> numbers(900);
  std::iota(numbers.begin(), numbers.end(), 4294967000U);  // wraps on the way
  std::vector<std::uint32_t> kept;
  for (const std::uint32_t number : numbers) {
    if (number == numbers.front() || number == numbers.back() || random() % 5 != 0) {
      kept.push_back(number);
    }
  }
  std::shuffle(kept.begin() + 1, kept.end(), random);
  SequenceTracker tracker;
  for (const std::uint32_t number : kept) {
    EXPECT_NE(tracker.observe(number), Arrival::kDuplicated);
    EXPECT_EQ(tracker.observe(number), Arrival::kDuplicated);
  }
  EXPECT_EQ(tracker.missing(), numbers.size() - kept.size());
}

TEST(SequenceTracker, StartsAnewAfterARestart) {
  SequenceTracker tracker;
  tracker.observe(500);
  tracker.observe(502);
  tracker.restart();
  EXPECT_EQ(tracker.observe(1), Arrival::kNewest);
  EXPECT_EQ(tracker.observe(2), Arrival::kNewest);
  EXPECT_EQ(tracker.missing(), 1U);
}

}  // namespace
}  // namespace forcegrid::link
