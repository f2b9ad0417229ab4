// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/operator_script.h"

#include <gtest/gtest.h>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;
using std::chrono::milliseconds;

class OperatorScriptTest : public testing::Test {
 protected:
  OperatorScript::Action at(int time_ms, bool host, std::uint64_t loads) {
    return script_.update(rt::TimePoint(milliseconds(time_ms)),
                          {.host_present = host, .counters_loaded = loads});
  }

  const Vector3d home_D_{0.025, 0.0, 0.205};
  OperatorScript::Options options_{.motion = MotionKind::kChirp,
                                   .contact_D = Vector3d(0.01, -0.02, 0.005)};
  OperatorScript script_{options_, home_D_};
};

TEST_F(OperatorScriptTest, PressesTheButtonOnceAFifthOfASecondAfterTheHostAppears) {
  int presses = 0;
  int pressed_at_ms = 0;
  for (int ms = 0; ms <= 3000; ++ms) {
    const auto action = at(ms, ms >= 1000, 0);
    EXPECT_EQ(action.target_D, home_D_);
    if (action.press_button) {
      ++presses;
      pressed_at_ms = ms;
    }
  }
  EXPECT_EQ(presses, 1);
  EXPECT_EQ(pressed_at_ms, 1200);
}

TEST_F(OperatorScriptTest, OneThatLetsGoStaysInThePoseAndIsGoneThreeSecondsAfterCalibration) {
  options_.lets_go = true;
  script_ = OperatorScript(options_, home_D_);
  int let_go_at_ms = 0;
  int times = 0;
  for (int ms = 0; ms <= 8000; ++ms) {
    const auto action = at(ms, true, ms >= 1000 ? 1 : 0);
    EXPECT_EQ(action.target_D, home_D_);
    if (action.let_go) {
      ++times;
      let_go_at_ms = ms;
    }
  }
  EXPECT_EQ(times, 1);
  EXPECT_EQ(let_go_at_ms, 4000);
}

TEST_F(OperatorScriptTest, ApproachesTouchesWaitsAndMovesAfterCalibration) {
  const Vector3d touch_D = options_.contact_D - Vector3d(0.0, 0.0, 0.0005);
  const Vector3d above_D = options_.contact_D + Vector3d(0.0, 0.0, 0.010);
  Vector3d last_D = home_D_;
  const auto run_to = [&](int from_ms, int to_ms, std::uint64_t loads) {
    Vector3d target_D;
    for (int ms = from_ms; ms <= to_ms; ++ms) {
      target_D = at(ms, true, loads).target_D;
      EXPECT_LT((target_D - last_D).norm(), 0.6e-3) << ms;  // 1.875 * 0.22 m / 1.2 s * 1 ms
      last_D = target_D;
    }
    return target_D;
  };
  EXPECT_EQ(run_to(0, 999, 0), home_D_);  // the button comes at 200 ms, command 1 at 1000 ms
  EXPECT_LT((run_to(1000, 2200, 1) - above_D).norm(), 1e-9);
  EXPECT_LT((run_to(2201, 2700, 1) - touch_D).norm(), 1e-9);
  EXPECT_LT((run_to(2701, 3200, 1) - touch_D).norm(), 1e-9);
  // A quarter of the way up the first cycle of the chirp: 0.2 t + 0.07 t^2 = 1/2 at t = 1.6 s.
  const Vector3d moved_D = run_to(3201, 5000, 1) - touch_D;
  EXPECT_GT(moved_D.z(), 0.015);
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kMoving);
}

TEST_F(OperatorScriptTest, PullsOutAndPushesInUntilTheDeviceIsHomedAndThenApproaches) {
  const OperatorScript::HomingGesture gesture{.out_D = {0.09, 0.0, 0.2}, .in_D = {-0.02, 0.0, 0.2}};
  options_.homing = gesture;
  script_ = OperatorScript(options_, home_D_);
  Vector3d last_D = home_D_;
  Vector3d target_D = home_D_;
  const auto run_to = [&](int from_ms, int to_ms, bool homed) {
    for (int ms = from_ms; ms <= to_ms; ++ms) {
      const auto action =
          script_.update(rt::TimePoint(milliseconds(ms)), {.host_present = true, .homed = homed});
      EXPECT_FALSE(action.press_button);
      target_D = action.target_D;
      EXPECT_LT((target_D - last_D).norm(), 0.6e-3) << ms << ": the target never jumps";
      last_D = target_D;
    }
  };
  // It begins at 0.2 s; a stroke takes 1.5 s and is followed by 0.3 s of rest.
  run_to(0, 199, false);
  EXPECT_EQ(target_D, home_D_);
  run_to(200, 1750, false);
  EXPECT_LT((target_D - gesture.out_D).norm(), 1e-9);
  run_to(1751, 3550, false);
  EXPECT_LT((target_D - gesture.in_D).norm(), 1e-9);
  run_to(3551, 5350, false);
  EXPECT_LT((target_D - gesture.out_D).norm(), 1e-9) << "again, as long as it is not homed";
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kCalibrating);
  run_to(5351, 6000, false);
  run_to(6001, 7210, true);  // homed in mid-stroke; 1.2 s to come back
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kApproaching);
  run_to(7211, 9500, true);
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kMoving);
}

TEST_F(OperatorScriptTest, GoesHomeWhenTheHostLeavesWithinTheHomingGesture) {
  options_.homing =
      OperatorScript::HomingGesture{.out_D = {0.09, 0.0, 0.2}, .in_D = {-0.02, 0.0, 0.2}};
  script_ = OperatorScript(options_, home_D_);
  for (int ms = 0; ms <= 1000; ++ms) {
    (void)at(ms, true, 0);
  }
  EXPECT_GT((at(1001, false, 0).target_D - home_D_).norm(), 0.01) << "from where it is";
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kReturning);
  EXPECT_EQ(at(2300, false, 0).target_D, home_D_);
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kWaiting);
}

TEST_F(OperatorScriptTest, FollowsAPointerOnlyWhileItMovesAndWithinItsReach) {
  options_.reach_low_D = {-0.05, -0.06, -0.02};
  options_.reach_high_D = {0.05, 0.06, 0.08};
  options_.reach_m_per_s = 0.7;
  script_ = OperatorScript(options_, home_D_);
  const Vector3d pointer_D(0.2, -0.2, 0.04);
  const Vector3d nearest_D(0.05, -0.06, 0.04);
  const auto pointed = [&](int time_ms, bool host, std::uint64_t loads) {
    return script_
        .update(rt::TimePoint(milliseconds(time_ms)),
                {.host_present = host, .counters_loaded = loads, .pointer_D = pointer_D})
        .target_D;
  };
  for (int ms = 0; ms <= 999; ++ms) {
    ASSERT_EQ(pointed(ms, true, 0), home_D_) << "a hand that moves would spoil the calibration";
  }
  Vector3d last_D = home_D_;
  for (int ms = 1000; ms <= 6000; ++ms) {
    const Vector3d target_D = pointed(ms, true, 1);
    ASSERT_LE((target_D - last_D).norm(), 0.7001e-3) << ms;
    last_D = target_D;
  }
  EXPECT_LT((last_D - nearest_D).norm(), 1e-6);
  for (int ms = 6001; ms <= 8500; ++ms) {
    const Vector3d target_D = pointed(ms, false, 1);
    ASSERT_LE((target_D - last_D).norm(), 1.0e-3) << ms << ": on the way home, as the script is";
    last_D = target_D;
  }
  EXPECT_EQ(last_D, home_D_) << "the host has gone";
}

TEST_F(OperatorScriptTest, CalibratedDevicesNeedNoButton) {
  options_.calibrated = true;
  script_ = OperatorScript(options_, home_D_);
  for (int ms = 0; ms <= 200; ++ms) {
    EXPECT_FALSE(at(ms, true, 0).press_button);
  }
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kApproaching);
}

TEST_F(OperatorScriptTest, HostThatLoadsCountersUnaskedGetsNoButton) {
  (void)at(0, false, 4);
  for (int ms = 1; ms <= 201; ++ms) {
    EXPECT_FALSE(at(ms, true, 5).press_button);
  }
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kApproaching);
}

TEST_F(OperatorScriptTest, ReturnsHomeWhenTheHostGoesAndStartsAgainWithTheNext) {
  (void)at(0, true, 0);
  (void)at(200, true, 0);
  (void)at(300, true, 1);
  for (int ms = 301; ms <= 4000; ++ms) {
    (void)at(ms, true, 1);
  }
  const Vector3d away_D = at(4001, false, 1).target_D;
  EXPECT_GT((away_D - home_D_).norm(), 0.1);
  EXPECT_EQ(script_.phase(), OperatorScript::Phase::kReturning);
  Vector3d last_D = away_D;
  for (int ms = 4002; ms <= 5300; ++ms) {
    const Vector3d target_D = at(ms, false, 1).target_D;
    ASSERT_LT((target_D - last_D).norm(), 0.6e-3);
    last_D = target_D;
  }
  EXPECT_EQ(last_D, home_D_);
  (void)at(6000, true, 1);
  EXPECT_TRUE(at(6200, true, 1).press_button);
}

}  // namespace
}  // namespace forcegrid::emulator
