// SPDX-License-Identifier: Apache-2.0
// The simulator's bad network: delays, orders and shares against what was asked for.

#include "simulator/impaired_link.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <vector>

namespace forcegrid::simulator {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr std::uint64_t kSeed = 7;
constexpr rt::TimePoint kStart{std::chrono::seconds(100)};

class ImpairedLinkTest : public testing::Test {
 protected:
  ImpairedLink make(const LinkConditions& conditions) {
    return {[this](const ImpairedLink::Message& message) {
              sent_.push_back(std::get<link::ForceSample>(message).echo_sequence);
            },
            conditions, kSeed};
  }
  static link::ForceSample sample(std::uint32_t number) {
    link::ForceSample sample;
    sample.echo_sequence = number;
    return sample;
  }
  std::vector<std::uint32_t> sent_;
};

TEST_F(ImpairedLinkTest, SendsAtOnceWhereNothingIsBad) {
  ImpairedLink link = make({});
  link.send(sample(1), kStart);
  EXPECT_EQ(sent_, std::vector<std::uint32_t>{1});
  EXPECT_FALSE(link.next());
  EXPECT_EQ(link.counts().delayed, 0U);
}

TEST_F(ImpairedLinkTest, DelaysByWhatIsAskedAndKeepsTheOrder) {
  ImpairedLink link = make({.delay_s = 0.05});
  link.send(sample(1), kStart);
  link.send(sample(2), kStart + milliseconds(10));
  EXPECT_EQ(link.next(), kStart + milliseconds(50));
  link.send_due(kStart + milliseconds(50) - microseconds(1));
  EXPECT_TRUE(sent_.empty());
  link.send_due(kStart + milliseconds(50));
  EXPECT_EQ(sent_, std::vector<std::uint32_t>{1});
  link.send_due(kStart + milliseconds(60));
  EXPECT_EQ(sent_, (std::vector<std::uint32_t>{1, 2}));
  EXPECT_EQ(link.counts().delayed, 2U);
}

TEST_F(ImpairedLinkTest, ChangesOnlyWhatIsSentFromThenOn) {
  ImpairedLink link = make({.delay_s = 0.05});
  link.send(sample(1), kStart);
  link.set({});
  link.send(sample(2), kStart + milliseconds(10));
  EXPECT_EQ(sent_, std::vector<std::uint32_t>{2}) << "it overtakes";
  link.send_due(kStart + milliseconds(50));
  EXPECT_EQ(sent_, (std::vector<std::uint32_t>{2, 1}));
}

// Uniform jitter of J: between 0 and J, J/2 on average (J/sqrt(12 n) its error), and datagrams 1/4
// J apart change their order now and then.
TEST_F(ImpairedLinkTest, JittersWithinItsRange) {
  constexpr int kSent = 4000;
  constexpr double kJitter_s = 0.02;
  ImpairedLink link = make({.delay_s = 0.1, .jitter_s = kJitter_s});
  double sum_s = 0.0;
  for (int i = 0; i < kSent; ++i) {
    link.send(sample(1), kStart);
    const double delay_s = rt::seconds(*link.next() - kStart);
    EXPECT_GE(delay_s, 0.1);
    EXPECT_LE(delay_s, 0.1 + kJitter_s);
    sum_s += delay_s - 0.1;
    link.clear();
  }
  EXPECT_NEAR(sum_s / kSent, kJitter_s / 2.0, 5.0 * kJitter_s / std::sqrt(12.0 * kSent));
  for (std::uint32_t i = 0; i < 200; ++i) {
    link.send(sample(i), kStart + milliseconds(5) * i);
  }
  link.send_due(kStart + std::chrono::seconds(10));
  EXPECT_EQ(sent_.size(), 200U);
  EXPECT_FALSE(std::is_sorted(sent_.begin(), sent_.end()));
}

// A share p of n is lost, with a standard deviation of sqrt(n p (1 - p)).
TEST_F(ImpairedLinkTest, LosesTheShareThatIsAskedFor) {
  constexpr int kSent = 10'000;
  for (const double loss : {0.1, 0.5, 1.0}) {
    sent_.clear();
    ImpairedLink link = make({.loss = loss});
    for (int i = 0; i < kSent; ++i) {
      link.send(sample(1), kStart);
    }
    EXPECT_NEAR(static_cast<double>(link.counts().lost), kSent * loss,
                5.0 * std::sqrt(kSent * loss * (1.0 - loss)))
        << loss;
    EXPECT_EQ(sent_.size() + link.counts().lost, static_cast<std::size_t>(kSent));
  }
}

TEST(LinkConditions, AreUsableInTheirRangesAlone) {
  EXPECT_TRUE((LinkConditions{10.0, 10.0, 1.0}.usable()));
  EXPECT_FALSE((LinkConditions{-1e-3, 0.0, 0.0}.usable()));
  EXPECT_FALSE((LinkConditions{0.0, 10.1, 0.0}.usable()));
  EXPECT_FALSE((LinkConditions{0.0, 0.0, 1.1}.usable()));
  EXPECT_FALSE((LinkConditions{std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0}.usable()));
}

}  // namespace
}  // namespace forcegrid::simulator
