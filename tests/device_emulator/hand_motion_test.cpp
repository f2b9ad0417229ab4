// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/hand_motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;
constexpr double kNominal_m = HandMotion::kNominalAmplitude_m;
constexpr MotionKind kAll[] = {MotionKind::kChirp, MotionKind::kLissajous, MotionKind::kRandom,
                               MotionKind::kPoke,  MotionKind::kHold,      MotionKind::kStill};

TEST(HandMotion, StartsAtZeroAndNeverJumpsOrGoesBelowItsStart) {
  for (const MotionKind kind : kAll) {
    const HandMotion motion(kind, kNominal_m, 3);
    EXPECT_EQ(motion.displacement_D(0.0), Vector3d::Zero()) << to_string(kind);
    EXPECT_EQ(motion.displacement_D(-1.0), Vector3d::Zero()) << to_string(kind);
    Vector3d last = Vector3d::Zero();
    double lowest_m = 0.0;
    for (int i = 1; i <= 40000; ++i) {
      const Vector3d now = motion.displacement_D(i * 1e-3);
      // The fastest is a poke: 18 mm in 100 ms, minimum-jerk peak 1.875 times the mean.
      ASSERT_LT((now - last).norm(), 1.1e-3 * 0.018 / 0.1 * 1.875) << to_string(kind) << " " << i;
      lowest_m = std::min(lowest_m, now.z());
      last = now;
    }
    // Drift and tremor of `hold` stay within its 12 mm.
    EXPECT_GE(lowest_m, -1e-12) << to_string(kind);
  }
}

TEST(HandMotion, StrokePressesSlidesToBothSidesAndLiftsAgainAndAgain) {
  const HandMotion motion(MotionKind::kStroke, kNominal_m, 1);
  Vector3d last = Vector3d::Zero();
  for (int i = 1; i <= 20000; ++i) {
    const Vector3d now = motion.displacement_D(i * 1e-3);
    // The fastest is the lift: 7 mm in half a second, minimum-jerk peak 1.875 times the mean.
    ASSERT_LT((now - last).norm(), 1.1e-3 * 0.007 / 0.5 * 1.875) << i;
    ASSERT_EQ(now.x(), 0.0);
    last = now;
  }
  // Down after half a second, out to 10 mm a second later and back in another; the other side; up.
  EXPECT_TRUE(motion.displacement_D(0.5).isApprox(Vector3d(0, 0, -0.003), 1e-9));
  EXPECT_TRUE(motion.displacement_D(1.5).isApprox(Vector3d(0, 0.010, -0.003), 1e-9));
  EXPECT_TRUE(motion.displacement_D(2.5).isApprox(Vector3d(0, 0, -0.003), 1e-9));
  EXPECT_TRUE(motion.displacement_D(3.5).isApprox(Vector3d(0, -0.010, -0.003), 1e-9));
  EXPECT_TRUE(motion.displacement_D(5.5).isApprox(Vector3d(0, 0, 0.004), 1e-9));
  EXPECT_TRUE(motion.displacement_D(13.5).isApprox(Vector3d(0, 0.010, -0.003), 1e-9));
}

TEST(HandMotion, StartsWithoutSpeed) {
  for (const MotionKind kind : kAll) {
    const HandMotion motion(kind, kNominal_m, 3);
    // A tenth of a millisecond at the start moves next to nothing.
    EXPECT_LT(motion.displacement_D(1e-4).norm(), 1e-8) << to_string(kind);
  }
}

TEST(HandMotion, ChirpIsOneMinusCosineOfARisingFrequency) {
  const HandMotion motion(MotionKind::kChirp, kNominal_m, 1);
  // phi / 2 pi = 0.2 t + 0.07 t^2 up to 20 s: 32 whole cycles there, and 3 per second afterwards.
  for (const double time_s : {0.7, 3.0, 12.3, 19.9}) {
    const double cycles = 0.2 * time_s + 0.07 * time_s * time_s;
    EXPECT_NEAR(motion.displacement_D(time_s).z(),
                0.010 * (1.0 - std::cos(2.0 * std::numbers::pi * cycles)), 1e-12);
    EXPECT_EQ(motion.displacement_D(time_s).head<2>().norm(), 0.0);
  }
  EXPECT_NEAR(motion.displacement_D(20.0).z(), 0.0, 1e-12);
  EXPECT_NEAR(motion.displacement_D(20.0 + 1.0 / 6.0).z(), 0.020, 1e-12);
  EXPECT_NEAR(motion.displacement_D(25.0 + 1.0 / 3.0).z(), 0.0, 1e-11);
  EXPECT_NEAR(chirp_frequency_Hz(0.0), 0.2, 1e-12);
  EXPECT_NEAR(chirp_frequency_Hz(10.0), 1.6, 1e-12);
  EXPECT_NEAR(chirp_frequency_Hz(30.0), 3.0, 1e-12);
}

TEST(HandMotion, RandomHasItsRmsAndLimits) {
  const HandMotion motion(MotionKind::kRandom, kNominal_m, 7);
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  Eigen::Array3d squares = Eigen::Array3d::Zero();
  int count = 0;
  for (double time_s = 1.0; time_s < 301.0; time_s += 0.01) {
    const Eigen::Array3d value = motion.displacement_D(time_s).array();
    EXPECT_LE(std::abs(value[0]), 0.018);
    EXPECT_LE(std::abs(value[1]), 0.018);
    EXPECT_LE(value[2], 0.024);
    sum += value;
    squares += value * value;
    ++count;
  }
  const Eigen::Array3d mean = sum / count;
  const Eigen::Array3d rms = (squares / count - mean * mean).sqrt();
  // 7, 7, 5.5 mm, a little less through tanh.
  EXPECT_GT(rms[0], 0.0055);
  EXPECT_LT(rms[0], 0.0070);
  EXPECT_GT(rms[1], 0.0055);
  EXPECT_LT(rms[1], 0.0070);
  EXPECT_GT(rms[2], 0.0042);
  EXPECT_LT(rms[2], 0.0055);
}

TEST(HandMotion, SameSeedSameMotionAnotherSeedAnother) {
  for (const MotionKind kind : {MotionKind::kRandom, MotionKind::kPoke}) {
    const HandMotion one(kind, kNominal_m, 5);
    const HandMotion same(kind, kNominal_m, 5);
    const HandMotion other(kind, kNominal_m, 6);
    EXPECT_EQ(one.displacement_D(2.0), same.displacement_D(2.0));
    EXPECT_GT((one.displacement_D(2.65) - other.displacement_D(2.65)).norm(), 1e-5);
  }
}

TEST(HandMotion, PokesReachEightTargetsWithin18MillimetresAndComeBack) {
  const HandMotion motion(MotionKind::kPoke, kNominal_m, 2);
  for (int poke = 0; poke < 16; ++poke) {
    const double start_s = 0.8 * poke;
    const Vector3d target = motion.displacement_D(start_s + 0.11);
    EXPECT_LE(target.norm(), 0.018);
    EXPECT_GE(target.norm(), 0.008);
    EXPECT_NEAR((motion.displacement_D(start_s + 0.44) - target).norm(), 0.0, 1e-12);
    EXPECT_EQ(motion.displacement_D(start_s + 0.6).norm(), 0.0);
    EXPECT_NEAR((motion.displacement_D(start_s + 0.11 + 6.4) - target).norm(), 0.0, 1e-9);
  }
}

TEST(HandMotion, AmplitudeScalesEveryMotion) {
  for (const MotionKind kind : kAll) {
    const HandMotion nominal(kind, kNominal_m, 4);
    const HandMotion half(kind, 0.5 * kNominal_m, 4);
    EXPECT_LT((half.displacement_D(1.3) - 0.5 * nominal.displacement_D(1.3)).norm(), 1e-15)
        << to_string(kind);
  }
}

TEST(HandMotion, UnknownNameIsAnErrorThatListsTheKnownOnes) {
  for (const MotionKind kind : kAll) {
    EXPECT_EQ(parse_motion(to_string(kind)), kind);
  }
  try {
    parse_motion("spiral");
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("spiral"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("lissajous"), std::string::npos);
  }
  EXPECT_THROW(HandMotion(MotionKind::kChirp, -0.01, 1), std::invalid_argument);
  EXPECT_THROW(HandMotion(MotionKind::kChirp, std::nan(""), 1), std::invalid_argument);
}

TEST(MinimumJerk, IsFlatAtBothEnds) {
  EXPECT_EQ(minimum_jerk(-1.0), 0.0);
  EXPECT_EQ(minimum_jerk(2.0), 1.0);
  EXPECT_NEAR(minimum_jerk(0.5), 0.5, 1e-15);
  EXPECT_LT(minimum_jerk(0.01), 1.1e-5);
  EXPECT_GT(minimum_jerk(0.99), 1.0 - 1.1e-5);
}

}  // namespace
}  // namespace forcegrid::emulator
