// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/passivity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kCycle_s = 0.002;
constexpr double kCount_m = 23e-6;
constexpr double kRounding_J = 1e-12;  // sums of some thousand products of the order of 1e-4 J

Vector3d rounded(const Vector3d& position_W) {
  return kCount_m * (position_W / kCount_m).array().round();
}

PassivityOptions observing() { return {.mode = PassivityMode::kObserve}; }

TEST(PassivityGuard, CountsTheWorkOfAConstantForceWhateverThePath) {
  PassivityGuard guard(observing());
  guard.set_resolution(Vector3d::Constant(kCount_m));
  const Vector3d force_W(1.0, 0.0, -2.0);
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> place_m(-0.05, 0.05);
  const Vector3d from_W(0.01, 0.02, 0.03);
  Vector3d position_W = from_W;
  EXPECT_EQ(guard.apply(0.0, position_W, force_W), force_W);
  for (int i = 0; i < 1000; ++i) {
    position_W = Vector3d(place_m(random), place_m(random), place_m(random));
    EXPECT_EQ(guard.apply(i % 2 == 0 ? kCycle_s : 0.001, position_W, force_W), force_W);
  }
  EXPECT_NEAR(guard.energy_to_hand_J(), force_W.dot(position_W - from_W), kRounding_J);
  EXPECT_NEAR(guard.axis_energy_to_hand_J().y(), 0.0, kRounding_J);
  EXPECT_NEAR(guard.total_energy_to_hand_J(), guard.energy_to_hand_J(), kRounding_J);
}

TEST(PassivityGuard, FindsTheEnergyThatSamplingAddsToASpring) {
  // F held over a step of a spring does K/2 |dP|^2 more than the spring itself.
  constexpr double kStiffness_N_per_m = 300.0;
  PassivityGuard guard(observing());
  double leak_J = 0.0;
  Vector3d last_W = Vector3d::Zero();
  for (int i = 0; i <= 500; ++i) {  // one turn, to where it began
    const double angle_rad = 2.0 * std::numbers::pi * i / 500.0;
    const Vector3d position_W =
        0.008 * Vector3d(1.0 - std::cos(angle_rad), std::sin(angle_rad), 0.0);
    static_cast<void>(guard.apply(kCycle_s, position_W, -kStiffness_N_per_m * position_W));
    leak_J += 0.5 * kStiffness_N_per_m * (position_W - last_W).squaredNorm();
    last_W = position_W;
  }
  EXPECT_NEAR(guard.energy_to_hand_J(), leak_J, kRounding_J);
  EXPECT_GT(leak_J, 1e-4);  // 0.19 mJ
}

TEST(PassivityGuard, SeesNoEnergyInATremblingCount) {
  constexpr double kStiffness_N_per_m = 5000.0;
  PassivityGuard guard(observing());
  guard.set_resolution(Vector3d::Constant(kCount_m));
  for (int i = 0; i < 5001; ++i) {
    const Vector3d position_W(kCount_m * (i % 2), 0.0, 0.0);
    static_cast<void>(guard.apply(kCycle_s, position_W, -kStiffness_N_per_m * position_W));
  }
  // Uncorrected each flip counts K q^2 / 2, 6.6 mJ in these 10 s.
  EXPECT_LT(std::abs(guard.energy_to_hand_J()), 0.02e-3);
}

TEST(PassivityGuard, CountsWhatTheHandReallyGotFromQuantisedPositions) {
  // The hand moves smoothly, the loop sees whole counts: what F really did is F . d(true position).
  std::mt19937_64 random(12);
  std::normal_distribution<double> jerk(0.0, 1.0);
  for (const double speed_mm_per_s : {0.3, 3.0, 30.0, 100.0}) {
    constexpr double kStiffness_N_per_m = 2000.0;
    PassivityGuard guard(observing());
    guard.set_resolution(Vector3d::Constant(kCount_m));
    const double amplitude_m = 0.004;
    const double omega_rad_per_s = 1e-3 * speed_mm_per_s / amplitude_m;
    const double seconds = std::min(60.0, 10.0 * 2.0 * std::numbers::pi / omega_rad_per_s);
    double reference_J = 0.0;
    double naive_J = 0.0;
    double sampling_J = 0.0;
    Vector3d last_W = Vector3d::Zero();
    Vector3d last_read_W = Vector3d::Zero();
    Vector3d force_W = Vector3d::Zero();
    double tremor_m = 0.0;
    static_cast<void>(guard.apply(0.0, Vector3d::Zero(), Vector3d::Zero()));
    for (int i = 1; i < static_cast<int>(seconds / kCycle_s); ++i) {
      tremor_m += 0.002 * (3e-6 * std::sqrt(500.0) * jerk(random) - 5.0 * tremor_m);
      const Vector3d position_W(amplitude_m * std::sin(omega_rad_per_s * kCycle_s * i) + tremor_m,
                                0.0, 0.0);
      const Vector3d read_W = rounded(position_W);
      reference_J += force_W.dot(position_W - last_W);
      sampling_J += 0.5 * kStiffness_N_per_m * (position_W - last_W).squaredNorm();
      naive_J += force_W.dot(read_W - last_read_W);
      last_W = position_W;
      last_read_W = read_W;
      force_W = guard.apply(kCycle_s, read_W, -kStiffness_N_per_m * read_W);
    }
    // Half a count under the last force; a sixth of what quantisation adds to the plain sum, and a
    // twentieth of what sampling does, since the velocity that tells them apart is filtered.
    const double tolerance_J = 0.5 * kCount_m * std::abs(force_W.x()) +
                               std::abs(naive_J - reference_J) / 6.0 + sampling_J / 20.0;
    EXPECT_NEAR(guard.energy_to_hand_J(), reference_J, tolerance_J) << speed_mm_per_s;
    if (speed_mm_per_s == 3.0) {
      EXPECT_GT(naive_J - reference_J, 0.5e-3) << "the test would not see an uncorrected observer";
    }
  }
}

// A lossless spring, moved 8 mm to and fro through its rest twice a second for a minute.
struct MovedSpring {
  double error_percent = 0.0;  ///< RMS of what was added over RMS of the spring's force
  double energy_J = 0.0;
  double account_J = 0.0;
};

MovedSpring moved_spring(const PassivityOptions& options, double stiffness_N_per_m) {
  PassivityGuard guard(options);
  guard.set_resolution(Vector3d::Constant(kCount_m));
  double added_N2 = 0.0;
  double wanted_N2 = 0.0;
  for (int i = 0; i < 30000; ++i) {
    const Vector3d read_W =
        rounded(Vector3d(0.008 * std::sin(4.0 * std::numbers::pi * kCycle_s * i), 0.0, 0.0));
    const Vector3d wanted_W = -stiffness_N_per_m * read_W;
    const Vector3d force_W = guard.apply(kCycle_s, read_W, wanted_W);
    added_N2 += (force_W - wanted_W).squaredNorm();
    wanted_N2 += wanted_W.squaredNorm();
  }
  return {100.0 * std::sqrt(added_N2 / wanted_N2), guard.energy_to_hand_J(), guard.account_J()};
}

TEST(PassivityGuard, LeavesTheEnergyOfSamplingToTheArmWhereItsDampingIsEnough) {
  // 0.3 N s/m bears the sampling of 300 N/m at 500 Hz.
  const MovedSpring soft = moved_spring({}, 250.0);
  const double mean_square_speed = 0.5 * std::pow(0.008 * 4.0 * std::numbers::pi, 2);
  const double leak_J = 0.5 * 250.0 * kCycle_s * mean_square_speed * 60.0;
  EXPECT_EQ(soft.error_percent, 0.0);
  EXPECT_NEAR(soft.energy_J, leak_J, 0.05 * leak_J);  // 75 mJ, and seen
  EXPECT_LT(std::abs(soft.account_J), 0.3e-3);
  // From 600 N/m on all of it is damped.
  PassivityOptions strict;
  strict.arm_damping_N_s_per_m = 0.0;
  EXPECT_NEAR(moved_spring({}, 1000.0).error_percent, moved_spring(strict, 1000.0).error_percent,
              1e-9);
  EXPECT_GT(moved_spring(strict, 250.0).error_percent, 0.5);
}

TEST(PassivityGuard, TrustsTheArmWithATenthLessOfWhatALoopSwingsWithByItself) {
  // 0.3 N s/m bears 300 N/m at 500 Hz, but of an oscillation of 11 Hz only 270.
  const auto account_J = [](double stiffness_N_per_m) {
    PassivityGuard guard(observing());
    for (int i = 0; i < 5000; ++i) {
      const double x_m = 0.001 * std::sin(2.0 * std::numbers::pi * 11.0 * kCycle_s * i);
      static_cast<void>(guard.apply(kCycle_s, Vector3d(x_m, 0.0, 0.0),
                                    Vector3d(-stiffness_N_per_m * x_m, 0.0, 0.0)));
    }
    return guard.account_J();
  };
  const double speed_square_m2_per_s2 = 0.5 * std::pow(0.001 * 2.0 * std::numbers::pi * 11.0, 2);
  const double leak_J = 0.5 * 290.0 * kCycle_s * speed_square_m2_per_s2 * 10.0;  // 7 mJ
  EXPECT_LT(std::abs(account_J(265.0)), 0.03 * leak_J);
  EXPECT_GT(account_J(290.0), 0.15 * leak_J);
  EXPECT_LT(account_J(290.0), 0.5 * leak_J);
}

TEST(PassivityGuard, LeavesAPassiveForceAlone) {
  PassivityGuard guard;
  for (int i = 0; i < 2000; ++i) {
    const double time_s = kCycle_s * i;
    const double rate_rad_per_s = 6.0;
    const Vector3d position_W(0.005 * std::sin(rate_rad_per_s * time_s), 0.0, 0.0);
    const Vector3d velocity_W(0.005 * rate_rad_per_s * std::cos(rate_rad_per_s * time_s), 0.0, 0.0);
    const Vector3d wanted_W = -3.0 * velocity_W;
    EXPECT_EQ(guard.apply(kCycle_s, position_W, wanted_W), wanted_W);
  }
  EXPECT_LT(guard.energy_to_hand_J(), 0.0);
}

TEST(PassivityGuard, DampsSoMuchThatTheNextCycleTakesTheExcessOut) {
  // After 1 N has pushed the tool 0.2 m/s fast for 2 ms, 0.4 mJ have been given, 0.1 mJ too much.
  PassivityOptions options;
  options.velocity_time_constant_s = 1e-6;  // velocity is the step's
  options.bound_J = 10.0;
  PassivityGuard guard(options);
  const Vector3d step_W(0.0004, 0.0, 0.0);
  static_cast<void>(guard.apply(0.0, Vector3d::Zero(), Vector3d(1.0, 0.0, 0.0)));
  const Vector3d force_W = guard.apply(kCycle_s, step_W, Vector3d::Zero());
  EXPECT_NEAR(guard.energy_to_hand_J(), 0.4e-3, kRounding_J);
  EXPECT_NEAR(guard.damping_N_s_per_m(), 0.1e-3 / (kCycle_s * 0.2 * 0.2), 1e-9);
  EXPECT_NEAR(force_W.x(), -0.1e-3 / 0.0004, 1e-9);
  static_cast<void>(guard.apply(kCycle_s, 2.0 * step_W, Vector3d::Zero()));
  EXPECT_NEAR(guard.energy_to_hand_J(), options.allowance_J, kRounding_J);
}

TEST(PassivityGuard, NeverDampsMoreThanItsLargestDamping) {
  PassivityOptions options;
  options.bound_J = 10.0;
  PassivityGuard guard(options);
  double x_m = 0.0;
  static_cast<void>(guard.apply(0.0, Vector3d::Zero(), Vector3d(5.0, 0.0, 0.0)));
  for (int i = 0; i < 100; ++i) {
    x_m += 0.0002;
    const Vector3d force_W =
        guard.apply(kCycle_s, Vector3d(x_m, 0.0, 0.0), Vector3d(5.0, 0.0, 0.0));
    EXPECT_LE(5.0 - force_W.x(), options.max_damping_N_s_per_m * 0.1 + 1e-12);
  }
  EXPECT_EQ(guard.damping_N_s_per_m(), options.max_damping_N_s_per_m);
}

// A tool 5 mm within a spring of which nothing was felt until now, as when the first answer of an
// object comes late: the spring owes 12.5 mJ.
class SpringFromNowhere : public ::testing::Test {
 protected:
  static constexpr double kStiffness_N_per_m = 1000.0;
  static constexpr double kDepth_m = 0.005;
  static constexpr double kSpeed_m_per_s = 0.02;

  SpringFromNowhere() {
    x_m_ = kDepth_m;
    static_cast<void>(guard_.apply(0.0, Vector3d(x_m_, 0.0, 0.0), Vector3d::Zero()));
    rest(0.1);
  }
  void rest(double time_s) {
    for (double passed_s = 0.0; passed_s < time_s; passed_s += kCycle_s) {
      cycle();
    }
  }
  void move_to(double x_m) {
    const double way_m = x_m - x_m_;
    const int cycles = static_cast<int>(std::lround(std::abs(way_m) / (kSpeed_m_per_s * kCycle_s)));
    for (int i = 0; i < cycles; ++i) {
      x_m_ += way_m / cycles;
      cycle();
    }
  }
  double owed_J() const { return 0.5 * kStiffness_N_per_m * x_m_ * x_m_; }

  PassivityGuard guard_;
  double x_m_ = 0.0;
  double force_N_ = 0.0;

 private:
  void cycle() {
    force_N_ = guard_
                   .apply(kCycle_s, Vector3d(x_m_, 0.0, 0.0),
                          Vector3d(-kStiffness_N_per_m * x_m_, 0.0, 0.0))
                   .x();
  }
};

TEST_F(SpringFromNowhere, IsNotMadeStifferUnderAToolAtRestThanItsEnergyIsInTheAccount) {
  move_to(0.003);
  const double scale = guard_.scale();
  EXPECT_GT(scale, 0.0);
  EXPECT_LT(scale, 0.5);
  EXPECT_GT(owed_J() + guard_.account_J(), PassivityOptions().bound_J);
  rest(5.0);
  EXPECT_EQ(guard_.scale(), scale);
  EXPECT_LE(guard_.largest_energy_to_hand_J(), PassivityOptions().bound_J);
}

TEST_F(SpringFromNowhere, IsFeltWholeOnceTheToolHasBeenAtItsRest) {
  move_to(0.0);
  rest(0.1);
  move_to(kDepth_m);
  rest(0.2);
  EXPECT_EQ(guard_.scale(), 1.0);
  EXPECT_NEAR(force_N_, -kStiffness_N_per_m * kDepth_m, 1e-9);
}

TEST_F(SpringFromNowhere, IsPaidOffByDampingWhileItIsShortened) {
  move_to(0.003);
  move_to(kDepth_m);
  EXPECT_LT(guard_.scale(), 1.0);
  EXPECT_LT(guard_.account_J(), 0.0);
  EXPECT_EQ(guard_.damping_N_s_per_m(), PassivityOptions().max_damping_N_s_per_m);
  const double before = guard_.scale();
  for (int i = 0; i < 20; ++i) {
    move_to(0.003);
    move_to(kDepth_m);
  }
  EXPECT_GT(guard_.scale(), before + 0.1);
}

TEST(PassivityGuard, GivesBackAForceThatDependsOnNoPositionAsFarAsItWasPressedAgainst) {
  // Constant 2 N, at once: shortened. Pressed against over 20 mm it has got 40 mJ at most.
  PassivityGuard guard;
  const Vector3d force_W(-2.0, 0.0, 0.0);
  double x_m = 0.0;
  static_cast<void>(guard.apply(0.0, Vector3d::Zero(), Vector3d::Zero()));
  const auto move_mm = [&](double way_mm) {
    for (int i = 0; i < 500; ++i) {
      x_m += 1e-3 * way_mm / 500.0;
      static_cast<void>(guard.apply(kCycle_s, Vector3d(x_m, 0.0, 0.0), force_W));
    }
  };
  move_mm(-5.0);
  EXPECT_LT(guard.scale(), 0.5);
  EXPECT_LE(guard.largest_energy_to_hand_J(), 0.6e-3);
  for (int i = 0; i < 4; ++i) {
    move_mm(50.0);
  }
  EXPECT_EQ(guard.scale(), 1.0);
}

TEST(PassivityGuard, KeepsItsAccountByTheForceThatIsReallyRendered) {
  PassivityGuard guard(observing());
  static_cast<void>(guard.apply(0.0, Vector3d::Zero(), Vector3d(10.0, 0.0, 0.0)));
  guard.set_rendered(Vector3d(5.0, 0.0, 0.0));
  static_cast<void>(guard.apply(kCycle_s, Vector3d(0.001, 0.0, 0.0), Vector3d::Zero()));
  EXPECT_NEAR(guard.energy_to_hand_J(), 5e-3, kRounding_J);
}

TEST(PassivityGuard, ForgetsCreditWithItsAccountButNotInItsTotal) {
  PassivityGuard guard(observing());
  static_cast<void>(guard.apply(0.0, Vector3d::Zero(), Vector3d(-1.0, 0.0, 0.0)));
  static_cast<void>(guard.apply(kCycle_s, Vector3d(0.01, 0.0, 0.0), Vector3d::Zero()));
  EXPECT_NEAR(guard.energy_to_hand_J(), -0.01, kRounding_J);
  guard.open_account();
  EXPECT_EQ(guard.energy_to_hand_J(), 0.0);
  EXPECT_EQ(guard.account_J(), 0.0);
  EXPECT_NEAR(guard.total_energy_to_hand_J(), -0.01, kRounding_J);
}

TEST(PassivityGuard, TakesAGrantOffItsDebtButNotOffTheEnergy) {
  PassivityGuard guard(observing());
  static_cast<void>(guard.apply(0.0, Vector3d::Zero(), Vector3d(1.0, 0.0, 0.0)));
  static_cast<void>(guard.apply(kCycle_s, Vector3d(0.001, 0.0, 0.0), Vector3d::Zero()));
  guard.grant(0.4e-3);
  EXPECT_NEAR(guard.account_J(), 0.6e-3, kRounding_J);
  guard.grant(1.0);
  EXPECT_EQ(guard.account_J(), 0.0);
  EXPECT_NEAR(guard.energy_to_hand_J(), 1e-3, kRounding_J);
}

TEST(PassivityGuard, DoesNotCountAPauseOrWhatIsNotANumber) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  PassivityGuard guard;
  const Vector3d force_W(1.0, 0.0, 0.0);
  static_cast<void>(guard.apply(kCycle_s, Vector3d::Zero(), force_W));
  guard.restart();
  EXPECT_EQ(guard.apply(kCycle_s, Vector3d(0.05, 0.0, 0.0), force_W), force_W);
  EXPECT_EQ(guard.energy_to_hand_J(), 0.0);
  EXPECT_FALSE(guard.apply(kCycle_s, Vector3d::Zero(), Vector3d(nan, 0.0, 0.0)).allFinite());
  EXPECT_EQ(guard.apply(kCycle_s, Vector3d(nan, 0.0, 0.0), force_W), force_W);
  EXPECT_EQ(guard.apply(nan, Vector3d::Zero(), force_W), force_W);
  EXPECT_EQ(guard.apply(kCycle_s, Vector3d::Zero(), force_W), force_W);
  EXPECT_EQ(guard.energy_to_hand_J(), 0.0);
}

TEST(PassivityGuard, RefusesOptionsOutOfRange) {
  const auto with = [](auto&& change) {
    PassivityOptions options;
    change(options);
    PassivityGuard guard(options);
  };
  EXPECT_THROW(with([](auto& o) { o.allowance_J = -1e-9; }), std::invalid_argument);
  EXPECT_THROW(with([](auto& o) { o.bound_J = o.allowance_J; }), std::invalid_argument);
  EXPECT_THROW(with([](auto& o) { o.max_damping_N_s_per_m = -1.0; }), std::invalid_argument);
  EXPECT_THROW(with([](auto& o) { o.arm_damping_N_s_per_m = -1.0; }), std::invalid_argument);
  EXPECT_THROW(with([](auto& o) { o.transport_delay_s = -1e-3; }), std::invalid_argument);
  EXPECT_THROW(with([](auto& o) { o.moving_mass_kg = 0.0; }), std::invalid_argument);
  EXPECT_THROW(with([](auto& o) { o.velocity_time_constant_s = 0.0; }), std::invalid_argument);
  EXPECT_THROW(with([](auto& o) { o.dead_band_counts = std::nan(""); }), std::invalid_argument);
}

/// A device of 0.06 kg and 0.3 N s/m in a light hand of 0.05 kg, 2.5 N s/m and 100 N/m that follows
/// a circle-like motion of 8 mm and then holds still, as in the method study; forces are held for a
/// cycle, positions are read in whole counts. Three axes, each with this hand.
class HandAndDevice {
 public:
  static constexpr double kMass_kg = 0.06 + 0.05;
  static constexpr double kHandDamping_N_s_per_m = 2.5;
  static constexpr double kDeviceDamping_N_s_per_m = 0.3;
  static constexpr double kHandStiffness_N_per_m = 100.0;
  static constexpr double kMotion_s = 6.0;
  static constexpr double kWhole_s = 10.0;

  Vector3d read() const { return rounded(position_W_); }
  const Vector3d& position_W() const { return position_W_; }
  double time_s() const { return time_s_; }

  void advance(const Vector3d& force_W) {
    constexpr int kSteps = 20;
    constexpr double kStep_s = kCycle_s / kSteps;
    for (int i = 0; i < kSteps; ++i) {
      const Vector3d reference_W = reference(time_s_);
      const Vector3d reference_velocity_W =
          (reference(time_s_ + 1e-4) - reference(time_s_ - 1e-4)) / 2e-4;
      const Vector3d acceleration_W =
          (force_W + kHandStiffness_N_per_m * (reference_W - position_W_) +
           kHandDamping_N_s_per_m * (reference_velocity_W - velocity_W_) -
           kDeviceDamping_N_s_per_m * velocity_W_) /
          kMass_kg;
      velocity_W_ += kStep_s * acceleration_W;
      position_W_ += kStep_s * velocity_W_;
      time_s_ += kStep_s;
    }
  }

 private:
  static Vector3d reference(double time_s) {
    const double t_s = std::min(time_s, kMotion_s);
    const double grown = std::min(1.0, t_s / 0.5);
    return 0.008 * grown *
           Vector3d(std::sin(2.0 * t_s), std::sin(3.1 * t_s + 0.4), std::cos(5.3 * t_s));
  }

  Vector3d position_W_ = Vector3d::Zero();
  Vector3d velocity_W_ = Vector3d::Zero();
  double time_s_ = 0.0;
};

struct Course {
  double largest_m = 0.0;            ///< distance from the origin
  double hold_peak_to_peak_m = 0.0;  ///< in the last 2 s
  double added_error_percent = 0.0;  ///< RMS of rendered minus wanted over RMS of wanted
  double rattle_N = 0.0;  ///< RMS change a cycle of rendered minus wanted, in the last 2 s
  double largest_energy_J = 0.0;
  double largest_force_N = 0.0;
};

/// @param wanted_of what the object says to a position, called once a cycle.
template <typename Object>
Course run(PassivityOptions options, Object&& wanted_of) {
  PassivityGuard guard(options);
  guard.set_resolution(Vector3d::Constant(kCount_m));
  HandAndDevice hand;
  Course course;
  double error_N2 = 0.0;
  double wanted_N2 = 0.0;
  double rattle_N2 = 0.0;
  int held_cycles = 0;
  Vector3d low_W = Vector3d::Constant(1.0);
  Vector3d high_W = Vector3d::Constant(-1.0);
  Vector3d last_error_W = Vector3d::Zero();
  while (hand.time_s() < HandAndDevice::kWhole_s) {
    const Vector3d read_W = hand.read();
    const Vector3d wanted_W = wanted_of(read_W);
    const Vector3d force_W = guard.apply(kCycle_s, read_W, wanted_W);
    const Vector3d error_W = force_W - wanted_W;
    error_N2 += error_W.squaredNorm();
    wanted_N2 += wanted_W.squaredNorm();
    if (hand.time_s() > HandAndDevice::kWhole_s - 2.0) {
      rattle_N2 += (error_W - last_error_W).squaredNorm();
      ++held_cycles;
      low_W = low_W.cwiseMin(hand.position_W());
      high_W = high_W.cwiseMax(hand.position_W());
    }
    last_error_W = error_W;
    course.largest_force_N = std::max(course.largest_force_N, force_W.norm());
    course.largest_m = std::max(course.largest_m, hand.position_W().norm());
    if (course.largest_m > 1.0) {
      break;  // diverged
    }
    hand.advance(force_W);
  }
  course.hold_peak_to_peak_m = (high_W - low_W).maxCoeff();
  course.added_error_percent = 100.0 * std::sqrt(error_N2 / wanted_N2);
  course.rattle_N = std::sqrt(rattle_N2 / std::max(held_cycles, 1));
  course.largest_energy_J = guard.largest_energy_to_hand_J();
  return course;
}

auto spring(double stiffness_N_per_m) {
  return [=](const Vector3d& position_W) -> Vector3d { return -stiffness_N_per_m * position_W; };
}

/// Along one axis only, through whose rest all of the energy comes back twice a period.
auto spring_along_x(double stiffness_N_per_m) {
  return [=](const Vector3d& position_W) -> Vector3d {
    return Vector3d(-stiffness_N_per_m * position_W.x(), 0.0, 0.0);
  };
}

/// The spring's force of `age_s` ago.
auto late_spring(double stiffness_N_per_m, double age_s) {
  return [=, past = std::deque<Vector3d>()](const Vector3d& position_W) mutable -> Vector3d {
    past.push_back(-stiffness_N_per_m * position_W);
    if (past.size() > static_cast<std::size_t>(std::lround(age_s / kCycle_s)) + 1) {
      past.pop_front();
    }
    return past.front();
  };
}

/// Streaming: the force of the newest sample to arrive, 30 a second, 200 ms late, 30 % lost.
auto streamed_spring(double stiffness_N_per_m, std::uint64_t seed) {
  return [=, random = std::mt19937_64(seed), late = late_spring(stiffness_N_per_m, 0.2),
          held_W = Vector3d(Vector3d::Zero()), cycle = 0](const Vector3d& position_W) mutable {
    const Vector3d arriving_W = late(position_W);
    const bool lost = std::uniform_real_distribution<double>()(random) < 0.3;
    if (cycle++ % 17 == 0 && !lost) {
      held_W = arriving_W;
    }
    return held_W;
  };
}

TEST(PassivityGuardInALoop, AddsLittleErrorAndNoRattleToALosslessSpring) {
  for (const double stiffness_N_per_m : {50.0, 200.0, 800.0, 2000.0}) {
    for (const bool straight : {false, true}) {
      const Course course = straight ? run({}, spring_along_x(stiffness_N_per_m))
                                     : run({}, spring(stiffness_N_per_m));
      std::printf("%5.0f N/m%s: %.3f %% error added, %.4f mN of rattle\n", stiffness_N_per_m,
                  straight ? " along one axis" : "", course.added_error_percent,
                  1e3 * course.rattle_N);
      EXPECT_LE(course.added_error_percent, 0.3) << stiffness_N_per_m << " straight " << straight;
      EXPECT_LE(course.rattle_N, 1e-3) << stiffness_N_per_m << " straight " << straight;
      EXPECT_LE(course.hold_peak_to_peak_m, 0.3e-3) << stiffness_N_per_m;
    }
  }
}

TEST(PassivityGuardInALoop, LeavesACoupledObjectAloneAsAWholeButNotEachAxis) {
  // Conservative, with stiffness between axes: by axis it takes energy here and gives it there.
  Eigen::Matrix3d stiffness_N_per_m;
  stiffness_N_per_m << 200.0, 80.0, 0.0, 80.0, 200.0, 40.0, 0.0, 40.0, 200.0;
  const auto object = [=](const Vector3d& position_W) -> Vector3d {
    return -stiffness_N_per_m * position_W;
  };
  EXPECT_LE(run({}, object).added_error_percent, 0.3);
  PassivityOptions each_axis;
  each_axis.each_axis = true;
  EXPECT_GT(run(each_axis, object).added_error_percent, 0.6);
}

TEST(PassivityGuardInALoop, KeepsALateForceWithinBoundsThatDivergesWithoutIt) {
  // A force that is late by A adds -K A of damping; the loop has 2.8 N s/m, enough for 56 N/m.
  for (const double stiffness_N_per_m : {150.0, 400.0}) {
    EXPECT_GT(run(observing(), late_spring(stiffness_N_per_m, 0.05)).largest_m, 0.1)
        << stiffness_N_per_m;
    const Course course = run({}, late_spring(stiffness_N_per_m, 0.05));
    EXPECT_LT(course.largest_m, 0.03) << stiffness_N_per_m;
    EXPECT_LE(course.largest_energy_J, 1e-3) << stiffness_N_per_m;
  }
}

TEST(PassivityGuardInALoop, GivesLessThanAMillijouleWithLossesAndALongDelay) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const Course without = run(observing(), streamed_spring(200.0, seed));
    const Course course = run({}, streamed_spring(200.0, seed));
    EXPECT_GT(without.largest_energy_J, 10e-3) << "seed " << seed;
    EXPECT_LE(course.largest_energy_J, 1e-3) << "seed " << seed;
    EXPECT_LT(course.largest_force_N, 8.0) << "seed " << seed;
  }
}

TEST(PassivityGuardInALoop, DoesNotLowerTheLargestStableStiffness) {
  const auto stable = [](const PassivityOptions& options, double stiffness_N_per_m) {
    const Course course = run(options, spring(stiffness_N_per_m));
    return course.largest_m < 0.1 && course.hold_peak_to_peak_m < 0.3e-3;
  };
  double stiffness_N_per_m = 500.0;
  while (stable(observing(), 1.1 * stiffness_N_per_m)) {
    stiffness_N_per_m *= 1.1;
  }
  EXPECT_GT(stiffness_N_per_m, 1000.0);
  EXPECT_LT(stiffness_N_per_m, 1e4);
  // Every stiffness up to there, and beyond it: damping wins a third, shortening more.
  for (double lower = stiffness_N_per_m / 1.1; lower > 400.0; lower /= 1.5) {
    EXPECT_TRUE(stable({}, lower)) << lower;
  }
  EXPECT_TRUE(stable({}, stiffness_N_per_m)) << stiffness_N_per_m;
  EXPECT_TRUE(stable({}, 1.25 * stiffness_N_per_m)) << stiffness_N_per_m;
}

}  // namespace
}  // namespace forcegrid::servo
