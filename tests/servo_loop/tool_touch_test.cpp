// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/tool_touch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>
#include <random>
#include <stdexcept>
#include <vector>

#include "profiles/device_profile.h"

namespace forcegrid::servo {
namespace {

using contact::ToolShape;
using Eigen::Vector3d;

constexpr double kPeriod_s = 0.002;
constexpr double kStiffness_N_per_m = 300.0;
constexpr double kRadius_m = 0.008;

// Two loops' ends, without devices: spheres of 8 mm.
class TwoTools : public ::testing::Test {
 protected:
  explicit TwoTools(const ToolShape& shape = ToolShape::sphere(kRadius_m),
                    double stiffness_N_per_m = kStiffness_N_per_m) {
    for (std::size_t k = 0; k < 2; ++k) {
      touch_[k] =
          std::make_unique<ToolTouch>(ToolTouchOptions{.exchange = &exchange_,
                                                       .tool = k,
                                                       .stiffness_N_per_m = stiffness_N_per_m,
                                                       .shape = shape});
      touch_[k]->set_share(1.0);
    }
  }
  // A cycle of one of them.
  Vector3d cycle(std::size_t tool, double time_s, const Vector3d& position_W, double gain = 1.0) {
    const double elapsed_s = last_s_[tool] ? time_s - *last_s_[tool] : 0.0;
    last_s_[tool] = time_s;
    return touch_[tool]->force_W(rt::TimePoint(rt::from_seconds(100.0 + time_s)), elapsed_s,
                                 position_W, gain);
  }
  // Both rest there until the force has ramped in. Returns the time.
  double settle(const Vector3d& first_W, const Vector3d& second_W, double gain_of_first = 1.0) {
    double time_s = 0.0;
    for (; time_s < 2.0 * ToolTouch::kRampIn_s; time_s += kPeriod_s) {
      force_W_ = {cycle(0, time_s, first_W, gain_of_first), cycle(1, time_s + 0.001, second_W)};
    }
    return time_s;
  }

  ToolExchange exchange_{2};
  std::array<std::unique_ptr<ToolTouch>, 2> touch_;
  std::array<std::optional<double>, 2> last_s_;
  std::array<Vector3d, 2> force_W_{};
};

TEST_F(TwoTools, AreTwoSpheresWithASpringBetweenThem) {
  const Vector3d apart_W = 0.010 * Vector3d(2, -1, 2) / 3.0;  // 10 mm, of 16
  settle(apart_W, Vector3d::Zero());
  const Vector3d expected_W = kStiffness_N_per_m * 0.006 * Vector3d(2, -1, 2) / 3.0;
  EXPECT_LT((force_W_[0] - expected_W).norm(), 1e-12);
  EXPECT_EQ(force_W_[0], -force_W_[1]) << "action and reaction";
  EXPECT_NEAR(touch_[0]->largest_force_N(), 1.8, 1e-12);
  EXPECT_GT(touch_[1]->cycles_touching(), 100U);
}

TEST_F(TwoTools, DoNotPullAndDoNotTouchApart) {
  settle(Vector3d(0.0, 0.0161, 0.0), Vector3d::Zero());
  EXPECT_TRUE(force_W_[0].isZero(0.0));
  EXPECT_TRUE(force_W_[1].isZero(0.0));
  EXPECT_EQ(touch_[0]->cycles_touching(), 0U);
}

// Its work along a closed way is zero: the gap is a function of the place alone.
TEST_F(TwoTools, GiveNothingAlongAClosedWay) {
  double time_s = settle(Vector3d(0.0, 0.014, 0.0), Vector3d::Zero());
  double work_J = 0.0;
  double largest_J = 0.0;
  Vector3d before_W(0.0, 0.014, 0.0);
  Vector3d force_before_W = force_W_[0];
  constexpr int kSteps = 2000;
  for (int i = 1; i <= kSteps; ++i) {
    const double angle = 2.0 * M_PI * i / kSteps;
    const Vector3d at_W(0.006 * std::sin(angle), 0.012 + 0.002 * std::cos(angle),
                        0.004 * std::sin(2.0 * angle));
    time_s += kPeriod_s;
    const Vector3d force_W = cycle(0, time_s, at_W);
    cycle(1, time_s + 0.001, Vector3d::Zero());
    work_J += 0.5 * (force_W + force_before_W).dot(at_W - before_W);
    largest_J = std::max(largest_J, std::abs(work_J));
    before_W = at_W;
    force_before_W = force_W;
  }
  EXPECT_GT(largest_J, 1e-4);
  EXPECT_LT(std::abs(work_J), 1e-3 * largest_J);
}

TEST_F(TwoTools, AToolThatIsSilentIsLetGoOfAndComesBackSlowly) {
  double time_s = settle(Vector3d(0.0, 0.010, 0.0), Vector3d::Zero());
  const double full_N = force_W_[0].y();
  EXPECT_NEAR(full_N, 1.8, 1e-12);
  const double silent_s = time_s - kPeriod_s + 0.001;  // when the other one was last heard
  double before_N = full_N;
  for (; time_s < silent_s + 0.05; time_s += kPeriod_s) {
    const double force_N = cycle(0, time_s, Vector3d(0.0, 0.010, 0.0)).y();
    const double age_s = time_s - silent_s;
    const double expected_N = full_N * std::clamp((ToolTouch::kTooOld_s - age_s) /
                                                      (ToolTouch::kTooOld_s - ToolTouch::kOld_s),
                                                  0.0, 1.0);
    EXPECT_NEAR(force_N, expected_N, 1e-6) << age_s;
    EXPECT_LE(force_N, before_N + 1e-9);
    before_N = force_N;
  }
  EXPECT_EQ(before_N, 0.0);
  // It is there again.
  double largest_step_N = 0.0;
  for (const double again_s = time_s; time_s < again_s + 0.3; time_s += kPeriod_s) {
    cycle(1, time_s - 0.001, Vector3d::Zero());
    const double force_N = cycle(0, time_s, Vector3d(0.0, 0.010, 0.0)).y();
    largest_step_N = std::max(largest_step_N, force_N - before_N);
    before_N = force_N;
  }
  EXPECT_NEAR(before_N, full_N, 1e-9);
  EXPECT_LE(largest_step_N, full_N * kPeriod_s / ToolTouch::kRampIn_s * 1.01);
}

TEST_F(TwoTools, AHandThatGetsNoForceIsNoneToLeanOn) {
  settle(Vector3d(0.0, 0.010, 0.0), Vector3d::Zero(), 0.25);
  EXPECT_NEAR(force_W_[1].y(), -0.25 * 1.8, 1e-12);
  // Its own gain comes later, in its ForceRenderer, so that both hands get the same.
  EXPECT_NEAR(0.25 * force_W_[0].y(), -force_W_[1].y(), 1e-12);
}

TEST_F(TwoTools, WhereTheAxesMeetTheForceKeepsItsDirection) {
  double time_s = settle(Vector3d(0.0, 0.001, 0.0), Vector3d::Zero());
  time_s += kPeriod_s;
  const Vector3d force_W = cycle(0, time_s, Vector3d::Zero());
  EXPECT_NEAR(force_W.y(), kStiffness_N_per_m * 0.016, 1e-9);
}

TEST_F(TwoTools, APositionThatIsNotFinitePushesNobody) {
  const double time_s = settle(Vector3d(0.0, 0.010, 0.0), Vector3d::Zero());
  EXPECT_TRUE(cycle(0, time_s, Vector3d::Constant(NAN)).isZero(0.0));
  EXPECT_NEAR(cycle(1, time_s + 0.001, Vector3d::Zero()).y(), -1.8, 1e-12) << "the place before";
}

class TwoRods : public TwoTools {
 protected:
  TwoRods() : TwoTools(ToolShape::capsule(0.002, 0.040)) {}
};

// Upright rods of 40 mm touch wherever they are beside each other, and by their ends above.
TEST_F(TwoRods, TouchAlongTheirLength) {
  settle(Vector3d(0.003, 0.0, 0.035), Vector3d::Zero());
  EXPECT_LT((force_W_[0] - Vector3d(kStiffness_N_per_m * 0.001, 0.0, 0.0)).norm(), 1e-12);
  EXPECT_EQ(force_W_[0], -force_W_[1]);
}
TEST_F(TwoRods, TouchByTheirEnds) {
  settle(Vector3d(0.0, 0.0, 0.0435), Vector3d::Zero());  // the lower one's upper end is at 40 mm
  EXPECT_LT((force_W_[0] - Vector3d(0.0, 0.0, kStiffness_N_per_m * 0.0005)).norm(), 1e-12);
}

TEST(ToolTouch, WithoutAnExchangeOrStiffnessNothingTouches) {
  ToolTouch alone{ToolTouchOptions{}};
  EXPECT_TRUE(alone.force_W(rt::Clock::now(), kPeriod_s, Vector3d::Zero(), 1.0).isZero(0.0));
  ToolExchange exchange(2);
  EXPECT_THROW(ToolTouch({.exchange = &exchange, .tool = 2}), std::invalid_argument);
  EXPECT_THROW(ToolTouch({.exchange = &exchange, .stiffness_N_per_m = -1.0}),
               std::invalid_argument);
}

TEST(ToolTouch, TheLargestStiffnessIsThatOfADampedWallOfThePairsDistance) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ASSERT_EQ(profile.light_hand.damping_N_s_per_m, 2.5);
  const double frame_s = 1e-6 * profile.usb.frame_period_us;
  EXPECT_NEAR(largest_tool_stiffness_N_per_m(profile, 500.0), 2.5 / (0.006 + 2.0 * frame_s), 1e-9);
  EXPECT_NEAR(largest_tool_stiffness_N_per_m(profile, 4000.0), 2.5 / (0.00075 + 2.0 * frame_s),
              1e-9);
}

// Hands that give way to a force that ramps in are pushed apart by its whole spring, in which
// nobody has put anything.
TEST_F(TwoTools, ThatOverlapWhenTheForceBeginsArePushedApart) {
  constexpr double kHand_N_per_m = 100.0;
  std::array<double, 2> y_m = {-0.001, 0.001};  // of 16 mm: 14 overlap
  double time_s = 0.0;
  for (; time_s < 1.0; time_s += kPeriod_s) {
    const double gain = std::min(1.0, time_s / 0.5);
    for (std::size_t k = 0; k < 2; ++k) {
      const double force_N =
          gain * cycle(k, time_s + 0.001 * static_cast<double>(k), {0.0, y_m[k], 0.0}, gain).y();
      const double rest_m = k == 0 ? -0.001 : 0.001;
      y_m[k] += 0.1 * (rest_m + force_N / kHand_N_per_m - y_m[k]);  // a hand follows slowly
    }
  }
  // Each moves by x with 100 x = 300 (14 mm - 2 x).
  EXPECT_NEAR(y_m[1] - y_m[0], 0.002 + 2.0 * 300.0 * 0.014 / 700.0, 1e-4);
}

// ---- Two hands that collide ----

struct Collision {
  double before_J = 0.0;         // of motion
  double largest_after_J = 0.0;  // of motion, after they first parted
  double momentum_Ns = 0.0;      // of both, at the end, less that at the beginning
  bool parted = false;
};

// Hands along y with mass and damping, each with a loop of its own: positions by counts, forces
// held for a cycle and late by a bus frame. The loops run at any phase.
Collision collide(double stiffness_N_per_m, double damping_N_s_per_m, double phase_s,
                  double speed_m_per_s) {
  constexpr double kMass_kg = 0.15;
  constexpr double kStep_s = 2e-5;
  constexpr double kLate_s = 0.001;
  constexpr double kCount_m = 3e-5;
  ToolExchange exchange(2);
  std::array<std::unique_ptr<ToolTouch>, 2> touch;
  for (std::size_t k = 0; k < 2; ++k) {
    touch[k] = std::make_unique<ToolTouch>(ToolTouchOptions{.exchange = &exchange,
                                                            .tool = k,
                                                            .transport_delay_s = kLate_s,
                                                            .stiffness_N_per_m = stiffness_N_per_m,
                                                            .shape = ToolShape::sphere(kRadius_m)});
    touch[k]->set_share(1.0);
  }
  std::array<double, 2> y_m = {-0.05, 0.05};
  std::array<double, 2> v_m_per_s = {speed_m_per_s, -0.4 * speed_m_per_s};
  std::array<std::deque<std::pair<double, double>>, 2> on_the_way;  // time it acts, force
  std::array<double, 2> force_N{};
  std::array<double, 2> next_s = {0.0, phase_s};
  const auto energy_J = [&] {
    return 0.5 * kMass_kg * (v_m_per_s[0] * v_m_per_s[0] + v_m_per_s[1] * v_m_per_s[1]);
  };
  Collision result;
  result.before_J = energy_J();
  const double momentum_Ns = kMass_kg * (v_m_per_s[0] + v_m_per_s[1]);
  bool touched = false;
  for (double t = 0.0; t < 1.5; t += kStep_s) {
    for (std::size_t k = 0; k < 2; ++k) {
      if (t >= next_s[k]) {
        const double seen_m = kCount_m * std::round(y_m[k] / kCount_m);
        const Vector3d force_W = touch[k]->force_W(rt::TimePoint(rt::from_seconds(50.0 + t)),
                                                   kPeriod_s, Vector3d(0.0, seen_m, 0.0), 1.0);
        on_the_way[k].emplace_back(t + kLate_s, force_W.y());
        next_s[k] += kPeriod_s;
        touched = touched || force_W.y() != 0.0;
      }
      while (!on_the_way[k].empty() && t >= on_the_way[k].front().first) {
        force_N[k] = on_the_way[k].front().second;
        on_the_way[k].pop_front();
      }
      v_m_per_s[k] += kStep_s * (force_N[k] - damping_N_s_per_m * v_m_per_s[k]) / kMass_kg;
      y_m[k] += kStep_s * v_m_per_s[k];
    }
    result.parted = result.parted || (touched && y_m[1] - y_m[0] > 2.0 * kRadius_m + 0.001);
    if (result.parted) {
      result.largest_after_J = std::max(result.largest_after_J, energy_J());
    }
  }
  result.momentum_Ns = kMass_kg * (v_m_per_s[0] + v_m_per_s[1]) - momentum_Ns;
  return result;
}

TEST(TwoHands, EnergyDoesNotGrowInACollision) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  const double stiffness_N_per_m = largest_tool_stiffness_N_per_m(profile, 1.0 / kPeriod_s);
  constexpr unsigned kSeed = 24;
  std::mt19937 random(kSeed);
  std::printf("seed %u, %.0f N/m\n", kSeed, stiffness_N_per_m);
  for (int i = 0; i < 20; ++i) {
    const double phase_s = std::uniform_real_distribution(0.0, kPeriod_s)(random);
    const double speed = std::uniform_real_distribution(0.3, 0.6)(random);
    const Collision hands =
        collide(stiffness_N_per_m, profile.light_hand.damping_N_s_per_m, phase_s, speed);
    EXPECT_LT(hands.largest_after_J, hands.before_J) << phase_s << " " << speed;
  }
}

// Without any damping of the hands the spring's own bookkeeping is all that is left. Each end knows
// the other's only late, so that it overshoots its bound; without it the delays would add 5 mJ.
// Both hands get the same impulse.
TEST(TwoHands, WithoutDampingTheyGetLittleMore) {
  constexpr unsigned kSeed = 25;
  std::mt19937 random(kSeed);
  std::printf("seed %u\n", kSeed);
  double largest_gain_J = 0.0;
  constexpr double kImpulse_Ns = 2.0 * 0.075 * 0.42;  // of the reduced mass at the relative speed
  for (int i = 0; i < 20; ++i) {
    const double phase_s = std::uniform_real_distribution(0.0, kPeriod_s)(random);
    const Collision hands = collide(400.0, 0.0, phase_s, 0.3);
    ASSERT_TRUE(hands.parted);
    largest_gain_J = std::max(largest_gain_J, hands.largest_after_J - hands.before_J);
    EXPECT_LT(std::abs(hands.momentum_Ns), 1e-3 * kImpulse_Ns) << "action and reaction";
    EXPECT_LT(hands.largest_after_J, hands.before_J + 3.0 * ToolTouch::kBound_J);
  }
  std::printf("largest gain %.3f mJ of %.3f mJ\n", 1e3 * largest_gain_J,
              1e3 * 0.5 * 0.15 * 0.09 * 1.16);
}

}  // namespace
}  // namespace forcegrid::servo
