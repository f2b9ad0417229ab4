// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/first_touch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>

#include "tests/servo_loop/square_patch.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kCycle_s = 0.002;
constexpr double kMaxForce_N = 5.0;
constexpr double kStiffness_N_per_m = 400.0;
constexpr double kTolerance_N = 1e-6;  // a patch has single precision
constexpr double kHeight_m = 0.01;
constexpr std::uint32_t kAirEpoch = 4;

/// A square of 40 mm on z = 0 below a tool at the origin, 10 mm high, as stiff along x and y as z.
link::SurfacePatch square(double time_s) {
  link::SurfacePatch patch =
      square_patch(std::llround(1e9 * time_s), kHeight_m, kStiffness_N_per_m);
  patch.contact_epoch = kAirEpoch;
  patch.position_W_m = {0.0, 0.0, kHeight_m};
  constexpr auto kOfFloat = static_cast<float>(-kStiffness_N_per_m);
  patch.stiffness_W_N_per_m = {kOfFloat, kOfFloat, kOfFloat, 0.0F, 0.0F, 0.0F};
  return patch;
}

/// A tool that is moved cycle by cycle over the square. The method gives `method_force_W`.
class FirstTouchTest : public ::testing::Test {
 protected:
  FirstTouchTest() { sample(false); }

  void show(const link::SurfacePatch& patch) {
    const auto surface = near_surface(patch);
    ASSERT_TRUE(surface);
    touch_.take(*surface);
  }
  Vector3d to(const Vector3d& position_W) {
    time_s_ += kCycle_s;
    position_W_ = position_W;
    return touch_.force_W(time_s_, position_W, method_force_W_);
  }
  Vector3d to_height(double height_m) { return to(Vector3d(0.001, 0.002, height_m)); }
  /// Down from 4 mm by 0.5 mm a cycle, to 2 mm below the surface: touches at 4.25 cycles' end.
  Vector3d push_in() {
    show(square(time_s_));
    Vector3d force_W = Vector3d::Zero();
    for (double height_m = 0.004; height_m > -0.0021; height_m -= 0.0005) {
      force_W = to_height(height_m);
    }
    return force_W;
  }
  /// A sample of the simulator, computed for the newest cycle.
  void sample(bool in_contact) {
    touch_.answer(time_s_, time_s_, in_contact, in_contact ? kAirEpoch + 1 : kAirEpoch);
  }

  FirstTouch touch_{kMaxForce_N};
  Vector3d method_force_W_ = Vector3d::Zero();
  Vector3d position_W_ = Vector3d::Zero();
  double time_s_ = 100.0;
};

TEST_F(FirstTouchTest, AgainstAPlaneTheForceIsStiffnessTimesDepthFromTheSameCycleOn) {
  show(square(time_s_));
  for (const double height_m : {0.003, 0.0012, 0.0004}) {
    EXPECT_EQ(to_height(height_m), Vector3d::Zero());
    EXPECT_FALSE(touch_.acting());
  }
  for (const double depth_m : {0.0004, 0.001, 0.002}) {
    const Vector3d force_W = to_height(-depth_m);
    EXPECT_TRUE(touch_.acting());
    EXPECT_NEAR(force_W.z(), kStiffness_N_per_m * depth_m, kTolerance_N);
    EXPECT_NEAR(force_W.head<2>().norm(), 0.0, kTolerance_N);
  }
  EXPECT_EQ(touch_.counts().touches, 1U);
  EXPECT_EQ(touch_.counts().felt, 1U);
}

TEST_F(FirstTouchTest, BetweenTwoCyclesTheTouchLiesWhereTheSurfaceIs) {
  show(square(time_s_));
  to(Vector3d(0.000, 0.0, 0.001));
  const Vector3d force_W = to(Vector3d(0.004, 0.0, -0.001));
  // It came in at x = 2 mm, and from there went 2 mm aside and 1 mm down: the push is 0.4 N, and no
  // more than that is felt along the surface, of 0.8 N.
  EXPECT_NEAR(force_W.z(), 0.4, kTolerance_N);
  EXPECT_NEAR(force_W.x(), -0.4, kTolerance_N);
}

TEST_F(FirstTouchTest, ASphereTouchesWithItsTipAndOnASlopeBesideIt) {
  link::SurfacePatch patch = square(time_s_);
  patch.tool_radius_m = 0.005F;
  for (std::size_t v = 0; v < 4; ++v) {
    patch.vertices_W_m[v][2] += patch.vertices_W_m[v][0];  // 45 degrees, down toward -x
  }
  show(patch);
  const Vector3d normal_W = Vector3d(-1.0, 0.0, 1.0).normalized();
  // The sphere's centre is 5 mm above the tip, the plane goes through the origin: gap = h / sqrt 2
  // - (1 - 1 / sqrt 2) 5 mm for a tip at height h above it.
  const double touch_m = 0.005 * (std::sqrt(2.0) - 1.0);
  EXPECT_EQ(to(Vector3d(0.0, 0.0, touch_m + 1e-5)), Vector3d::Zero());
  const Vector3d force_W = to(Vector3d(0.0, 0.0, touch_m - 0.001));
  ASSERT_TRUE(touch_.acting());
  // J d = 0.4 N upward, of which the push is 0.4 / sqrt 2 and what lies along the slope as much.
  EXPECT_NEAR(force_W.dot(normal_W), 0.4 / std::sqrt(2.0), 1e-5);
  EXPECT_NEAR(force_W.z(), 0.4, 1e-5);
}

TEST_F(FirstTouchTest, NeverPullsAndEndsWhereTheToolLeavesWithoutAnAnswer) {
  push_in();
  for (double height_m = -0.002; height_m < 0.0005; height_m += 0.0001) {
    EXPECT_GE(to_height(height_m).z(), 0.0);
  }
  EXPECT_EQ(to_height(0.0006), Vector3d::Zero());
  EXPECT_FALSE(touch_.acting());
  EXPECT_EQ(touch_.counts().left, 1U);
  to_height(0.0008);
  to_height(-0.001);
  EXPECT_EQ(touch_.counts().touches, 2U) << "the patch is still good for another touch";
}

TEST_F(FirstTouchTest, NeverGivesMoreThanTheSafetyLimit) {
  show(square(time_s_));
  to_height(0.001);
  for (double depth_m = 0.001; depth_m < 0.1; depth_m *= 2.0) {
    EXPECT_LE(to_height(-depth_m).norm(), kMaxForce_N + kTolerance_N);
  }
  EXPECT_NEAR(to_height(-0.1).norm(), kMaxForce_N, kTolerance_N);
}

TEST_F(FirstTouchTest, HandsOverToTheMethodWithoutAStep) {
  const Vector3d before_W = push_in();
  method_force_W_ = Vector3d(0.3, 0.0, 1.1);
  sample(true);
  Vector3d last_W = before_W;
  const double most_N =
      (method_force_W_ - before_W).norm() * kCycle_s / FirstTouch::kHandOver_s + kTolerance_N;
  int cycles = 0;
  while (touch_.acting() && cycles < 100) {
    const Vector3d force_W = to(position_W_);
    EXPECT_LE((force_W - last_W).norm(), most_N);
    last_W = force_W;
    ++cycles;
  }
  EXPECT_EQ(last_W, method_force_W_);
  EXPECT_NEAR(cycles, FirstTouch::kHandOver_s / kCycle_s, 1.0);
  EXPECT_EQ(touch_.counts().answered, 1U);
  EXPECT_EQ(touch_.counts().unseen, 0U);
  EXPECT_NEAR(touch_.counts().wait_max_s, 4 * kCycle_s, 1e-9) << "since the cycle that saw it";
}

TEST_F(FirstTouchTest, FadesWhereTheSimulatorDeniesTheTouch) {
  show(square(time_s_));
  to_height(0.001);
  touch_.answer(time_s_, time_s_, false, kAirEpoch);  // says nothing about a later touch
  const double force_N = to_height(-0.001).z();
  touch_.answer(time_s_, time_s_ - kCycle_s, false, kAirEpoch);  // nor does this one
  EXPECT_NEAR(to_height(-0.001).z(), force_N, kTolerance_N);
  sample(false);
  double last_N = force_N;
  for (int i = 0; i < 15; ++i) {
    const double now_N = to_height(-0.001).z();
    EXPECT_LE(now_N, last_N);
    EXPECT_GE(now_N, last_N - force_N * kCycle_s / FirstTouch::kFade_s - kTolerance_N);
    last_N = now_N;
  }
  EXPECT_EQ(to_height(-0.001), Vector3d::Zero());
  EXPECT_EQ(touch_.counts().denied, 1U);
  EXPECT_EQ(touch_.counts().touches, 1U) << "it must come out before it can touch again";
}

TEST_F(FirstTouchTest, FadesWhereNoAnswerComes) {
  push_in();
  const double begun_s = time_s_;
  while (touch_.acting() && time_s_ - begun_s < 1.0) {
    to(position_W_);
  }
  EXPECT_NEAR(time_s_ - begun_s, FirstTouch::kPatience_s + FirstTouch::kFade_s, 0.012);
  EXPECT_EQ(to(position_W_), Vector3d::Zero());
  EXPECT_EQ(touch_.counts().denied, 1U);
}

TEST_F(FirstTouchTest, WithoutAStiffnessATouchIsCountedAndNotFelt) {
  link::SurfacePatch patch = square(time_s_);
  patch.has_stiffness = false;
  patch.stiffness_W_N_per_m = {};
  show(patch);
  to_height(0.001);
  EXPECT_EQ(to_height(-0.001), Vector3d::Zero());
  EXPECT_EQ(touch_.counts().touches, 1U);
  method_force_W_ = Vector3d(0.0, 0.0, 0.7);
  sample(true);
  EXPECT_EQ(to_height(-0.001), method_force_W_) << "nothing to hand over, so no time for it";
  EXPECT_EQ(touch_.counts().felt, 0U);
}

TEST_F(FirstTouchTest, AToolThatSlidesFeelsWhatItWasPressedAhead) {
  link::SurfacePatch patch = square(time_s_);
  patch.has_stiffness = false;
  patch.stiffness_W_N_per_m = {};
  patch.has_press_forces = true;
  patch.press_forces_W_N = {{{0.0F, 0.0F, 0.5F}, {0.0F, 0.0F, 1.0F}}};
  show(patch);
  to_height(0.0005);
  EXPECT_NEAR(to_height(-0.0005).z(), 0.25, kTolerance_N);
  EXPECT_NEAR(to_height(-0.0015).z(), 0.75, kTolerance_N);
  sample(true);
  method_force_W_ = Vector3d(0.0, 0.0, 1.05);
  Vector3d force_W = Vector3d::Zero();
  while (touch_.acting()) {
    force_W = to_height(-0.0015);
    EXPECT_GT(force_W.z(), 0.7) << "handed over as stiffness is";
  }
  EXPECT_EQ(force_W, method_force_W_);
}

TEST_F(FirstTouchTest, AGrasperTouchesWithTheTipOfEitherJaw) {
  constexpr double kRadius_m = 0.004;
  constexpr double kLength_m = 0.03;
  constexpr double kOpening_rad = 0.7;
  const double aside_m = kLength_m * std::sin(0.5 * kOpening_rad);
  const double up_m = kLength_m * (1.0 - std::cos(0.5 * kOpening_rad));
  link::SurfacePatch patch = square(time_s_);
  patch.tool_radius_m = static_cast<float>(kRadius_m);
  patch.tool_length_m = static_cast<float>(kLength_m);
  patch.tool_opening_crad = 70;
  // Over the square, one jaw alone over it, the other one alone, and none.
  for (const auto& [x_m, touches] : {std::pair{0.0, true},
                                     {0.02 + 0.5 * aside_m, true},
                                     {-0.02 - 0.5 * aside_m, true},
                                     {0.03 + aside_m, false}}) {
    SCOPED_TRACE(x_m);
    patch.echo_servo_time_ns = std::llround(1e9 * time_s_);
    show(patch);
    to(Vector3d(x_m, 0.0, 0.001));
    EXPECT_EQ(to(Vector3d(x_m, 0.0, -up_m + 1e-5)), Vector3d::Zero()) << "the tip hangs higher";
    const double force_N = to(Vector3d(x_m, 0.0, -up_m - 0.001)).z();
    EXPECT_NEAR(force_N, touches ? kStiffness_N_per_m * 0.001 : 0.0, 1e-5);
    to(Vector3d(x_m, 0.0, 0.002));
    EXPECT_FALSE(touch_.acting());
  }
}

TEST_F(FirstTouchTest, AStiffnessThatPullsGivesNothing) {
  link::SurfacePatch patch = square(time_s_);
  for (std::size_t i = 0; i < 3; ++i) {
    patch.stiffness_W_N_per_m[i] = 1e7F;
  }
  show(patch);
  to_height(0.001);
  EXPECT_EQ(to_height(-0.001), Vector3d::Zero());
}

TEST_F(FirstTouchTest, BelievesNoPatchThatIsStaleOfAnotherEpochOrEndsThere) {
  show(square(time_s_ - FirstTouch::kStale_s));
  to_height(0.001);
  EXPECT_EQ(to_height(-0.001), Vector3d::Zero());
  link::SurfacePatch other = square(time_s_);
  other.contact_epoch = kAirEpoch - 1;
  show(other);
  to_height(0.001);
  EXPECT_EQ(to_height(-0.001), Vector3d::Zero());
  show(square(time_s_));
  to(Vector3d(0.021, 0.0, 0.001));
  EXPECT_EQ(to(Vector3d(0.021, 0.0, -0.001)), Vector3d::Zero()) << "beyond the patch";
  EXPECT_EQ(touch_.counts().touches, 0U);
}

TEST_F(FirstTouchTest, AToolThatIsFirstSeenInsideHasNotTouched) {
  show(square(time_s_));
  EXPECT_EQ(to_height(-0.002), Vector3d::Zero());
  EXPECT_EQ(to_height(-0.001), Vector3d::Zero());
  to_height(0.001);
  EXPECT_NEAR(to_height(-0.001).z(), 0.4, kTolerance_N);
}

TEST_F(FirstTouchTest, LeavesTheForceToTheMethodInAContactThatItHasNotSeen) {
  method_force_W_ = Vector3d(0.0, 0.0, 0.7);
  to_height(-0.001);
  sample(true);
  show(square(time_s_));
  EXPECT_EQ(to_height(0.001), method_force_W_);
  EXPECT_EQ(to_height(-0.001), method_force_W_);
  EXPECT_EQ(touch_.counts().unseen, 1U);
  EXPECT_EQ(touch_.counts().touches, 0U);
}

TEST_F(FirstTouchTest, APositionThatIsNotFiniteTouchesNothing) {
  show(square(time_s_));
  to_height(0.001);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(to(Vector3d(0.0, 0.0, nan)), Vector3d::Zero());
  EXPECT_EQ(to_height(-0.001), Vector3d::Zero()) << "what lay between is not known";
}

TEST(NearSurface, IsNoneOfAMessageThatIsNoSurface) {
  EXPECT_TRUE(near_surface(square(1.0)));
  link::SurfacePatch patch = square(1.0);
  patch.triangles[1][2] = 4;
  EXPECT_FALSE(near_surface(patch)) << "a corner that is not there";
  patch = square(1.0);
  patch.vertices_W_m[3][0] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(near_surface(patch));
  patch = square(1.0);
  patch.vertex_count = 20;
  EXPECT_FALSE(near_surface(patch));
}

}  // namespace
}  // namespace forcegrid::servo
