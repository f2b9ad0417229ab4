// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/hand_follower.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;
using std::chrono::microseconds;

// Follows in steps of 1 ms, and watches how fast the target moves.
class Follow {
 public:
  Vector3d to(const Vector3d& script_D, const std::optional<Vector3d>& pointer_D) {
    now_ += microseconds(1000);
    const Vector3d target_D = follower.update(now_, script_D, pointer_D);
    if (steps_ > 0) {
      const Vector3d speed_D = 1e3 * (target_D - last_D_);
      most_m_per_s = std::max(most_m_per_s, speed_D.norm());
      if (steps_ > 1) {
        most_m_per_s2 = std::max(most_m_per_s2, 1e3 * (speed_D - speed_D_).norm());
      }
      speed_D_ = speed_D;
    }
    last_D_ = target_D;
    ++steps_;
    return target_D;
  }

  HandFollower follower;
  double most_m_per_s = 0.0;
  double most_m_per_s2 = 0.0;

 private:
  rt::TimePoint now_{};
  Vector3d last_D_ = Vector3d::Zero();
  Vector3d speed_D_ = Vector3d::Zero();
  int steps_ = 0;
};

// 8 mm at 1.5 Hz: 75 mm/s and 0.71 m/s^2.
Vector3d swing_D(int ms) {
  return {0.1, 0.0, 0.008 * std::sin(2.0 * std::numbers::pi * 1.5e-3 * ms)};
}
constexpr double kSwing_m_per_s = 0.008 * 2.0 * std::numbers::pi * 1.5;
constexpr double kSwing_m_per_s2 = kSwing_m_per_s * 2.0 * std::numbers::pi * 1.5;

TEST(HandFollower, WithoutAPointerItIsTheScriptToTheLastBit) {
  Follow follow;
  for (int ms = 0; ms < 1000; ++ms) {
    ASSERT_EQ(follow.to(swing_D(ms), std::nullopt), swing_D(ms));
  }
  EXPECT_FALSE(follow.follower.away());
}

TEST(HandFollower, AJumpBecomesAReachThatDoesNotOvershoot) {
  struct Case {
    double jump_m;
    double done_s;  ///< to 1 %
    double most_m_per_s;
  };
  // Critically damped: (1 + w t) exp(-w t) = 0.01 at w t = 6.64, and a peak of w d / e, to w h / 2
  // = 1.6 % of the first-order rule with steps h; later where the acceleration is limited. 0.3 m
  // takes 0.3 s at 1 m/s, and more to start and to brake.
  for (const Case& c :
       {Case{0.003, 0.217, 0.0347}, Case{0.03, 0.23, 0.347}, Case{0.3, 0.5, 1.0 / 1.016}}) {
    Follow follow;
    const Vector3d start_D(0.01, 0.02, 0.03);
    const Vector3d way_D = c.jump_m * Vector3d(2.0, -1.0, 2.0) / 3.0;
    follow.to(start_D, std::nullopt);
    int done_ms = 0;
    for (int ms = 1; ms <= 1000; ++ms) {
      const Vector3d gone_D = follow.to(start_D, start_D + way_D) - start_D;
      const double share = gone_D.dot(way_D) / way_D.squaredNorm();
      ASSERT_LE(share, 1.0 + 1e-9) << "overshoot, " << c.jump_m << " m";
      ASSERT_LT((gone_D - share * way_D).norm(), 1e-12) << "straight on";
      done_ms = share < 0.99 ? ms + 1 : done_ms;
    }
    EXPECT_LE(1e-3 * done_ms, c.done_s) << c.jump_m;
    EXPECT_LE(follow.most_m_per_s, 1.0161 * c.most_m_per_s) << c.jump_m;
    EXPECT_LE(follow.most_m_per_s2, HandFollower::kMost_m_per_s2 * (1.0 + 1e-6)) << c.jump_m;
    EXPECT_TRUE(follow.follower.away());
  }
}

TEST(HandFollower, LetGoItReturnsIntoTheMovingScriptWithoutAJump) {
  Follow follow;
  int ms = 0;
  const auto run = [&](int until_ms, const std::optional<Vector3d>& pointer_D) {
    Vector3d target_D;
    for (; ms < until_ms; ++ms) {
      target_D = follow.to(swing_D(ms), pointer_D);
    }
    return target_D;
  };
  run(100, std::nullopt);  // in mid-swing
  const Vector3d pointer_D(0.12, 0.01, 0.02);
  EXPECT_LT((run(1100, pointer_D) - pointer_D).norm(), 1e-6);
  EXPECT_TRUE(follow.follower.away());
  // As soon done as a jump of this size, and for good.
  EXPECT_LT((run(1400, std::nullopt) - swing_D(1399)).norm(), 1e-3);
  EXPECT_EQ(run(2200, std::nullopt), swing_D(2199));
  EXPECT_FALSE(follow.follower.away());
  // Again, but let go on the way there, at full speed.
  run(2260, pointer_D);
  run(3500, std::nullopt);
  EXPECT_FALSE(follow.follower.away());
  EXPECT_LE(follow.most_m_per_s, 0.4 + kSwing_m_per_s);
  EXPECT_LE(follow.most_m_per_s2, HandFollower::kMost_m_per_s2 + 2.0 * kSwing_m_per_s2);
}

TEST(HandFollower, SlowOrIrregularUpdatesChangeThePathLittle) {
  Follow every_ms;
  HandFollower other;
  const Vector3d pointer_D(0.03, 0.0, 0.0);
  every_ms.to(Vector3d::Zero(), std::nullopt);
  (void)other.update(rt::TimePoint(microseconds(1000)), Vector3d::Zero(), std::nullopt);
  std::int64_t now_us = 1000;
  Vector3d other_D = Vector3d::Zero();
  const std::int64_t steps_us[] = {250, 125, 1000, 625, 2000, 500};  // 4.5 ms
  for (int turn = 0; turn < 22; ++turn) {
    for (const std::int64_t step_us : steps_us) {
      now_us += step_us;
      other_D = other.update(rt::TimePoint(microseconds(now_us)), Vector3d::Zero(), pointer_D);
    }
    if (turn % 2 == 1) {
      Vector3d target_D;
      for (int ms = 0; ms < 9; ++ms) {
        target_D = every_ms.to(Vector3d::Zero(), pointer_D);
      }
      // A step of the first-order rule shifts the path by about half its length of time.
      EXPECT_LT((other_D - target_D).norm(), 0.35 * 1e-3) << turn;
    }
  }
}

}  // namespace
}  // namespace forcegrid::emulator
