// SPDX-License-Identifier: Apache-2.0
// The view's copies of the force methods against the methods that a servo loop runs: the same
// force, at the tool and everywhere else, from what goes over the feed.

#include "view/method_copies.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <limits>
#include <numbers>
#include <random>

#include "cli/run/view_feed.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "rt/vectors.h"
#include "servo_loop/servo_loop.h"
#include "tests/servo_loop/scripted_device.h"
#include "view/field_slice.h"
#include "view_link/little_endian.h"

namespace forcegrid::view {
namespace {

using Eigen::Vector3d;
using servo::ArrivedSample;

constexpr std::chrono::milliseconds kPeriod{2};
constexpr int kCyclesPerSample = 16;
constexpr std::size_t kLate = 20;  // cycles from a tool state to its sample

MethodOptions options_of_methods() {
  MethodOptions options;
  options.grid.min_W = Vector3d::Constant(-0.05);
  options.grid.max_W = Vector3d::Constant(0.05);
  options.grid.cells = {24, 24, 24};
  return options;
}

// A stiffening spring below z = 0.
ArrivedSample answer(const Vector3d& position_W, double time_s, bool requested) {
  ArrivedSample arrived;
  arrived.sample.time_s = time_s;
  arrived.sample.position_W = position_W;
  arrived.sample.from_query = requested;
  arrived.in_contact = requested || position_W.z() < 0.0;
  arrived.sample.contact_point_W = Vector3d(position_W.x(), position_W.y(), 0.0);
  if (arrived.in_contact) {
    const Vector3d moved(0.3 * position_W.x(), 0.2 * position_W.y(), position_W.z());
    arrived.sample.force_W = -(120.0 + 4000.0 * moved.norm()) * moved;
  }
  return arrived;
}

class MethodCopiesTest : public testing::Test {
 protected:
  // A loop with these methods, whose tool presses, slides about and leaves the object. Each
  // arrival and each record goes to `take`, as over the feed.
  template <typename Take>
  void run(int cycles, const Take& take) {
    servo::ServoOptions options;
    options.check_motors = false;
    options.watch_encoders = false;
    options.requests_per_s = kRequests_per_s;
    options.fill_budget = kFillBudget;
    servo::ServoLoop loop(device_, profile_, methods_, ports_, options);
    std::uint32_t epoch = 0;
    bool touching = false;
    std::deque<std::pair<Vector3d, rt::TimePoint>> path;
    std::deque<std::pair<int, ArrivedSample>> answers;
    for (int i = 0; i < cycles; ++i) {
      now_ += kPeriod;
      const double phase = 2.0 * std::numbers::pi * 1e-3 * i;
      const Vector3d position(0.012 * std::sin(1.7 * phase), 0.009 * std::sin(2.3 * phase),
                              0.004 - 0.012 * std::sin(phase));
      device_.show(position, now_ - std::chrono::milliseconds(1));
      path.emplace_back(position, now_);
      const auto arrive = [&](ArrivedSample arrived) {
        arrived.sample.contact_epoch = epoch;
        arrived.arrived = now_;
        ASSERT_TRUE(ports_.samples.push(arrived));
        take(cli::sample_of(arrived));
      };
      if (path.size() > kLate && i % kCyclesPerSample == 0) {
        const auto& [then_W, when] = path[path.size() - 1 - kLate];
        const ArrivedSample sample = answer(then_W, servo::servo_time_s(when), false);
        epoch += sample.in_contact && !touching ? 1 : 0;
        touching = sample.in_contact;
        arrive(sample);
      }
      while (!answers.empty() && answers.front().first <= i) {
        arrive(answers.front().second);
        answers.pop_front();
      }
      ASSERT_EQ(loop.run_cycle(now_, now_ + kPeriod), servo::Fault::kNone);
      link::Query query;
      while (ports_.queries.pop(query)) {
        answers.emplace_back(
            i + 15, answer(rt::to_vector(query.position_W_m), servo::servo_time_s(now_), true));
        ++requests_;
      }
      servo::CycleRecord record;
      while (ports_.records.pop(record)) {
        take(cli::cycle_of(record));
      }
    }
  }

  MethodCopies copies() const {
    return MethodCopies({.methods = names_,
                         .base = options_of_methods(),
                         .fill_budget = kFillBudget,
                         .requests_per_s = kRequests_per_s,
                         .max_force_N = profile_.limits.max_force_N});
  }

  void make_methods() {
    for (const std::string& name : names_) {
      const MethodVariant variant = parse_method_variant(name, options_of_methods());
      owned_.push_back(make_force_method(variant.name, variant.options));
      methods_.push_back(owned_.back().get());
    }
  }

  static constexpr double kRequests_per_s = 60.0;
  static constexpr int kFillBudget = 400;
  profiles::DeviceProfile profile_ = profiles::load_device_profile("woodenhaptics_v2015");
  servo::ScriptedDevice device_{profile_};
  std::vector<std::string> names_{"auto", "forcegrid", "kriging nug=1e-6"};
  std::vector<std::unique_ptr<ForceMethod>> owned_;
  std::vector<ForceMethod*> methods_;
  servo::ServoPorts ports_;
  rt::TimePoint now_{std::chrono::seconds(1000)};
  int requests_ = 0;
};

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
