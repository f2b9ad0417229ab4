// SPDX-License-Identifier: Apache-2.0
// The view's copies of the force methods against the methods that a servo loop runs: the same
// force, at the tool and everywhere else, from what goes over the feed.

#include "view/method_copies.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <limits>
#include <random>

#include "rt/vectors.h"
#include "tests/view/copied_loop.h"
#include "view/field_slice.h"
#include "view_link/little_endian.h"

namespace forcegrid::view {
namespace {

using Eigen::Vector3d;

using MethodCopiesTest = CopiedLoop;

TEST_F(MethodCopiesTest, HaveTheServosForceToTheLastBit) {
  make_methods();
  MethodCopies copied = copies();
  // The end is in contact.
  run(4250, [&](const auto& sent) { copied.take(sent); });
  EXPECT_GT(requests_, 20);
  EXPECT_TRUE(copied.exact());
  EXPECT_EQ(copied.largest_difference_N(), 0.0);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> place(-0.03, 0.03);
  int known = 0;
  for (int i = 0; i < 300; ++i) {
    const Vector3d position(place(random), place(random), place(random));
    for (std::size_t method = 0; method < names_.size(); ++method) {
      const ForceEstimate own = methods_[method]->force(servo::servo_time_s(now_), position);
      const ForceEstimate copy = copied.force(method, position);
      EXPECT_EQ(copy.force_W, own.force_W) << names_[method];
      EXPECT_EQ(copy.status, own.status) << names_[method];
      known += own.force_W.norm() > 0.1 ? 1 : 0;
    }
  }
  EXPECT_GT(known, 100) << "the field has something to compare";
}

TEST_F(MethodCopiesTest, FollowRequestsAndBudgetThatChangeOnTheWay) {
  make_methods();
  MethodCopies copied = copies();
  int cycles = 0;
  run(4250, [&](const auto& sent) {
    copied.take(sent);
    if constexpr (std::is_same_v<std::decay_t<decltype(sent)>, view_link::FeedCycle>) {
      ++cycles;
      if (cycles == 900) {
        ports_.budget_reads = 1.2 * *methods_[0]->least_budget_reads();
      } else if (cycles == 1500) {
        ports_.requests_per_s = 250.0;
      } else if (cycles == 2600) {
        ports_.requests_per_s = 0.0;
        ports_.budget_reads = std::numeric_limits<double>::infinity();
      }
    }
  });
  EXPECT_GT(requests_, 100);
  EXPECT_TRUE(copied.exact());
  EXPECT_EQ(copied.largest_difference_N(), 0.0);
}

// A sample is announced by the link's thread, a cycle by telemetry's: either may be first.
TEST_F(MethodCopiesTest, WaitForASampleThatComesAfterItsCycle) {
  make_methods();
  MethodCopies copied = copies();
  std::deque<view_link::FeedSample> late;
  run(2000, [&](const auto& sent) {
    if constexpr (std::is_same_v<std::decay_t<decltype(sent)>, view_link::FeedSample>) {
      late.push_back(sent);
      if (late.size() > 3) {
        copied.take(late.front());
        late.pop_front();
      }
    } else {
      copied.take(sent);
    }
  });
  for (const view_link::FeedSample& sample : late) {
    copied.take(sample);
  }
  EXPECT_TRUE(copied.exact());
  EXPECT_EQ(copied.largest_difference_N(), 0.0);
}

TEST_F(MethodCopiesTest, SayThatTheyAreNotExactAfterAGap) {
  make_methods();
  MethodCopies copied = copies();
  int cycles = 0;
  run(1000, [&](const auto& sent) {
    if constexpr (std::is_same_v<std::decay_t<decltype(sent)>, view_link::FeedCycle>) {
      if (++cycles == 500) {
        return;
      }
    }
    copied.take(sent);
  });
  EXPECT_FALSE(copied.exact());
}

TEST_F(MethodCopiesTest, ShowASliceOfTheField) {
  make_methods();
  MethodCopies copied = copies();
  run(250, [&](const auto& sent) { copied.take(sent); });
  const SliceWish wish{.method = 2, .compared = 1, .normal = 1, .size_m = 0.02, .points = 5};
  ASSERT_STREQ(problem_of(wish, copied.size()), "");
  const Vector3d center(0.001, 0.002, -0.003);
  const view_link::Bytes bytes = slice_message(copied, wish, center);
  view_link::Reader reader(bytes);
  EXPECT_EQ((reader.take<std::array<std::uint8_t, 4>>()),
            (std::array<std::uint8_t, 4>{6, 2, 1, 1}));
  EXPECT_EQ(reader.take<std::uint16_t>(), 5);
  EXPECT_EQ(reader.take<std::uint16_t>(), 1) << "exact";
  const auto corner = reader.take<std::array<float, 3>>();
  const auto across = reader.take<std::array<float, 3>>();
  const auto along = reader.take<std::array<float, 3>>();
  // Across y: columns along z, rows along x.
  EXPECT_FLOAT_EQ(corner[0], 0.001F - 0.01F);
  EXPECT_FLOAT_EQ(corner[1], 0.002F);
  EXPECT_FLOAT_EQ(corner[2], -0.003F - 0.01F);
  EXPECT_FLOAT_EQ(across[2], 0.005F);
  EXPECT_FLOAT_EQ(along[0], 0.005F);
  for (int row = 0; row < 5; ++row) {
    for (int column = 0; column < 5; ++column) {
      const Vector3d place(0.001 - 0.01 + 0.005 * row, 0.002, -0.003 - 0.01 + 0.005 * column);
      const Vector3d expected = copied.force(2, place).force_W - copied.force(1, place).force_W;
      const auto value = reader.take<std::array<float, 5>>();
      EXPECT_NEAR(value[0], expected.x(), 1e-5);
      EXPECT_NEAR(value[2], expected.z(), 1e-5);
      EXPECT_EQ(value[4], static_cast<float>(copied.force(2, place).status));
    }
  }
  EXPECT_TRUE(reader.ok());
  EXPECT_EQ(reader.left(), 0U);
}

TEST(SliceWish, IsRefusedWhereItCanNotBeMet) {
  EXPECT_STRNE(problem_of({.method = 2}, 2), "");
  EXPECT_STRNE(problem_of({.compared = 2}, 2), "");
  EXPECT_STRNE(problem_of({.normal = 3}, 2), "");
  EXPECT_STRNE(problem_of({.size_m = std::nan("")}, 2), "");
  EXPECT_STRNE(problem_of({.points = 66}, 2), "");
  EXPECT_STREQ(problem_of({}, 1), "");
}

TEST_F(MethodCopiesTest, LeaveOutTheMethodThatIsASimulator) {
  names_ = {"direct", "hold"};
  MethodCopies copied = copies();
  EXPECT_EQ(copied.size(), 2U);
  EXPECT_EQ(copied.force(0, Vector3d::Zero()).status, EstimateStatus::kUnknown);
}

}  // namespace
}  // namespace forcegrid::view
