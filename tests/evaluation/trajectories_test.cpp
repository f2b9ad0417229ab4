// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/trajectories.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "evaluation/objects/force_table.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kPeriod_s = 0.002;

struct Measured {
  Vector3d min_m = Vector3d::Constant(1.0);
  Vector3d max_m = Vector3d::Constant(-1.0);
  Vector3d rms_m = Vector3d::Zero();  // around the mean
  double peak_speed_m_per_s = 0.0;
};

// Of the displacement from the first contact point.
Measured measure(const Trajectory& trajectory, double from_s = 0.0) {
  Measured measured;
  Vector3d sum = Vector3d::Zero();
  Vector3d squares = Vector3d::Zero();
  double count = 0.0;
  for (double t_s = from_s; t_s < trajectory.duration_s(); t_s += kPeriod_s) {
    const Vector3d d = trajectory.position_W(t_s) - first_contact_point_W();
    measured.min_m = measured.min_m.cwiseMin(d);
    measured.max_m = measured.max_m.cwiseMax(d);
    sum += d;
    squares += d.cwiseProduct(d);
    count += 1.0;
    const Vector3d next = trajectory.position_W(t_s + kPeriod_s) - first_contact_point_W();
    measured.peak_speed_m_per_s =
        std::max(measured.peak_speed_m_per_s, (next - d).norm() / kPeriod_s);
  }
  measured.rms_m = (squares / count - (sum / count).cwiseProduct(sum / count)).cwiseSqrt();
  return measured;
}

TEST(Trajectory, ChirpRisesTo190MillimetresASecond) {
  const Measured chirp = measure(Trajectory("chirp"));
  EXPECT_NEAR(chirp.peak_speed_m_per_s, 0.19, 0.004);
  EXPECT_NEAR(chirp.max_m.z(), 0.020, 1e-5);
  EXPECT_NEAR(chirp.min_m.z(), 0.0, 1e-12);
  EXPECT_EQ(chirp.max_m.x(), 0.0);
  // A turn of 0.2 Hz at its start: the quarter comes when 0.2 t + 0.07 t^2 = 1/4, z = 10 mm.
  const double quarter_s = (-0.2 + std::sqrt(0.04 + 0.07)) / 0.14;
  EXPECT_NEAR((Trajectory("chirp").position_W(quarter_s) - first_contact_point_W()).z(), 0.010,
              1e-12);
}

TEST(Trajectory, ObliqueChirpHasTheRecordingsRange) {
  const Measured chirp = measure(Trajectory("chirp_oblique"), 2.0);
  EXPECT_NEAR(chirp.max_m.x(), 0.0165, 1e-5);
  EXPECT_NEAR(chirp.min_m.y(), -0.004, 1e-5);
  EXPECT_NEAR(chirp.max_m.z(), 0.009, 1e-5);
  EXPECT_NEAR(chirp.min_m.z(), 0.003, 1e-5);
}

TEST(Trajectory, LissajousHasTheRecordingsRange) {
  const Measured lissajous = measure(Trajectory("lissajous"), 3.0);
  EXPECT_NEAR(lissajous.max_m.x(), 0.014, 1e-4);
  EXPECT_NEAR(lissajous.min_m.y(), -0.014, 1e-4);
  EXPECT_NEAR(lissajous.max_m.z(), 0.0215, 1e-4);
  EXPECT_NEAR(lissajous.min_m.z(), 0.0005, 1e-4);
}

TEST(Trajectory, RandomHasTheRecordingsRmsAndLimits) {
  // The recording's, once tanh has bent 7, 7, 5.5 mm: 6.3, 6.1, 4.6 mm. 20 s of slow sines scatter.
  Vector3d mean_rms_m = Vector3d::Zero();
  constexpr int kSeeds = 10;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Measured random = measure(Trajectory("random", seed), 2.0);
    mean_rms_m += random.rms_m / kSeeds;
    EXPECT_LE(random.max_m.x(), 0.016) << "seed " << seed;
    EXPECT_GE(random.min_m.y(), -0.016) << "seed " << seed;
    EXPECT_GE(random.min_m.z(), 0.0) << "seed " << seed;
    EXPECT_LE(random.max_m.z(), 0.022) << "seed " << seed;
    EXPECT_LT(random.peak_speed_m_per_s, 0.3) << "seed " << seed;
  }
  EXPECT_NEAR(mean_rms_m.x(), 0.0062, 0.0006);
  EXPECT_NEAR(mean_rms_m.y(), 0.0062, 0.0006);
  EXPECT_NEAR(mean_rms_m.z(), 0.0046, 0.0005);
}

TEST(Trajectory, PokeHoldsEightTargetsInTurn) {
  const Trajectory poke("poke");
  const auto distance_m = [&poke](double t_s) {
    return (poke.position_W(t_s) - first_contact_point_W()).norm();
  };
  EXPECT_DOUBLE_EQ(poke.duration_s(), 16.0);
  double nearest_m = 1.0;
  double farthest_m = 0.0;
  for (int k = 0; k < 20; ++k) {
    const double begin_s = 0.8 * k;
    EXPECT_EQ(distance_m(begin_s + 0.04), 0.0);
    EXPECT_NEAR(distance_m(begin_s + 0.16), distance_m(begin_s + 0.49), 1e-12);
    EXPECT_NEAR(distance_m(begin_s + 0.10), 0.5 * distance_m(begin_s + 0.3), 1e-9);
    EXPECT_NEAR(distance_m(begin_s + 0.61), 0.0, 1e-12);
    EXPECT_NEAR(distance_m(begin_s + 0.3), distance_m(0.8 * (k % 8) + 0.3), 1e-12);
    nearest_m = std::min(nearest_m, distance_m(begin_s + 0.3));
    farthest_m = std::max(farthest_m, distance_m(begin_s + 0.3));
  }
  EXPECT_NEAR(nearest_m, 0.005, 1e-9);
  EXPECT_NEAR(farthest_m, 0.0204, 1e-4);
  // Minimum jerk: 15/8 of the mean speed.
  EXPECT_NEAR(measure(poke).peak_speed_m_per_s, 15.0 / 8.0 * farthest_m / 0.1, 0.005);
}

TEST(Trajectory, HoldStaysNearTwelveMillimetresWithATremor) {
  const Measured hold = measure(Trajectory("hold"), 1.0);
  EXPECT_NEAR(0.5 * (hold.max_m.z() + hold.min_m.z()), 0.012, 2e-4);
  EXPECT_LT((hold.max_m - hold.min_m).maxCoeff(), 2.0 * (0.00064 + 0.00025) + 1e-4);
  // Of 0.2 to 0.3 mm at 8.4 to 10.7 Hz: 0.0106, 0.0151, 0.0202 m/s together, and a little drift.
  EXPECT_NEAR(hold.peak_speed_m_per_s, 0.027, 0.003);
}

TEST(Trajectory, NoneLeavesTheForceTableOrJumps) {
  const TableLattice range;
  for (const std::string& name : trajectory_names()) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Trajectory trajectory(name, seed);
      Vector3d before_W = trajectory.position_W(0.0);
      EXPECT_LT((before_W - first_contact_point_W()).norm(), 0.003) << name;
      for (double t_s = 0.0; t_s < trajectory.duration_s(); t_s += kPeriod_s) {
        const Vector3d position_W = trajectory.position_W(t_s);
        ASSERT_LT((position_W - before_W).norm(), 0.001) << name << " at " << t_s << " s";
        before_W = position_W;
        ASSERT_TRUE((position_W.array() >= 0.0).all()) << name;
        ASSERT_TRUE((position_W.array() <= Eigen::Array3d(0.16, 0.12, 0.12)).all()) << name;
        const int contact = trajectory.contact_at(t_s);
        if (contact >= 0) {
          Vector3d d =
              position_W - trajectory.contacts()[static_cast<std::size_t>(contact)].point_W;
          if (trajectory.is_exploration()) {
            d.head<2>().setZero();  // folded into the table
          }
          ASSERT_TRUE((d.array() >= range.min_W_m.array() - 1e-9).all()) << name << ' ' << t_s;
          ASSERT_TRUE((d.array() <= range.max_W_m().array() + 1e-9).all()) << name << ' ' << t_s;
        }
      }
    }
  }
}

TEST(Trajectory, TappingTouchesAndLeavesTheRestPose) {
  const Trajectory tapping("tapping", 4);
  EXPECT_EQ(tapping.contacts().size(), 25U);
  for (const ContactSpan& span : tapping.contacts()) {
    EXPECT_LT((tapping.position_W(span.begin_s + 1e-9) - span.point_W).norm(), 1e-9);
    EXPECT_LT((tapping.position_W(span.end_s - 1e-9) - span.point_W).norm(), 1e-9);
    const double middle_s = 0.5 * (span.begin_s + span.end_s);
    const double depth_m = (span.point_W - tapping.position_W(middle_s)).z();
    EXPECT_GE(depth_m, 0.0025 - 1e-9);
    EXPECT_LE(depth_m, 0.0045 + 1e-9);
    EXPECT_GT(tapping.position_W(span.end_s + 0.2).z(), span.point_W.z());
    EXPECT_EQ(tapping.contact_at(span.end_s + 0.01), -1);
  }
}

TEST(Trajectory, RegrabHoldsFourteenPlacesAndVariesTheirStiffnessWhenAsked) {
  const Trajectory same("regrab", 2);
  const Trajectory varied("regrab_varied", 2);
  ASSERT_EQ(same.contacts().size(), 14U);
  ASSERT_EQ(varied.contacts().size(), 14U);
  double least = 1.0;
  double most = 1.0;
  for (std::size_t i = 0; i < 14; ++i) {
    EXPECT_EQ(same.contacts()[i].force_factor, 1.0);
    EXPECT_EQ(same.contacts()[i].point_W, varied.contacts()[i].point_W);
    least = std::min(least, varied.contacts()[i].force_factor);
    most = std::max(most, varied.contacts()[i].force_factor);
    EXPECT_NEAR(same.contacts()[i].end_s - same.contacts()[i].begin_s, 1.0, 1e-12);
  }
  EXPECT_GE(least, 0.7);
  EXPECT_LT(least, 0.85);
  EXPECT_LE(most, 1.3);
  EXPECT_GT(most, 1.15);
}

TEST(Trajectory, CircleTurnsAtEightMillimetresInATiltedPlane) {
  const Trajectory circle("circle");
  const Vector3d centre_W = first_contact_point_W() + Vector3d(0.0, 0.0, 0.009);
  const Vector3d normal_W = Vector3d(0.0, -1.0, 1.0).normalized();
  for (double t_s = 1.0; t_s < 5.0; t_s += 0.01) {
    const Vector3d arm_W = circle.position_W(t_s) - centre_W;
    EXPECT_NEAR(arm_W.norm(), Trajectory::kLoopRadius_m, 1e-12);
    EXPECT_NEAR(arm_W.dot(normal_W), 0.0, 1e-12);
    EXPECT_LT((circle.position_W(t_s + 1.25) - circle.position_W(t_s)).norm(), 1e-12);
  }
}

TEST(Trajectory, SameSeedSameMotionOtherSeedAnother) {
  EXPECT_EQ(Trajectory("random", 3).position_W(4.0), Trajectory("random", 3).position_W(4.0));
  EXPECT_NE(Trajectory("random", 3).position_W(4.0), Trajectory("random", 4).position_W(4.0));
}

TEST(Trajectory, UnknownNameListsTheKnownOnes) {
  try {
    const Trajectory unknown("wobble");
    FAIL() << "no error";
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("'wobble'"));
    EXPECT_THAT(error.what(), HasSubstr("chirp, chirp_oblique, lissajous, random, poke, hold"));
  }
}

TEST(SeededNumbers, AreUniformAndNormal) {
  SeededNumbers numbers(1);
  double sum = 0.0;
  double normal_sum = 0.0;
  double normal_squares = 0.0;
  constexpr int kCount = 40000;
  for (int i = 0; i < kCount; ++i) {
    const double uniform = numbers.uniform(-2.0, 4.0);
    ASSERT_GE(uniform, -2.0);
    ASSERT_LT(uniform, 4.0);
    sum += uniform;
    const double normal = numbers.normal();
    normal_sum += normal;
    normal_squares += normal * normal;
  }
  EXPECT_NEAR(sum / kCount, 1.0, 0.05);
  EXPECT_NEAR(normal_sum / kCount, 0.0, 0.025);
  EXPECT_NEAR(normal_squares / kCount, 1.0, 0.035);
}

}  // namespace
}  // namespace forcegrid::evaluation
