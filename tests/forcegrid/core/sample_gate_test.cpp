// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/core/sample_gate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

namespace forcegrid {
namespace {

using Eigen::Vector3d;

constexpr double kPeriod_s = 1.0 / 30.0;
constexpr double kMaxForce_N = 8.0;

Vector3d hand_m(double time_s) {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  return 0.008 * Vector3d(std::sin(kTurn * 0.53 * time_s), std::sin(kTurn * 0.71 * time_s),
                          std::sin(kTurn * 0.97 * time_s));
}

Sample sample_at(double time_s, const Vector3d& position_m, const Vector3d& force_N) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = position_m;
  sample.force_W = force_N;
  return sample;
}

// 200 N/m, hardening.
Vector3d spring_N(const Vector3d& position_m) {
  return -(200.0 + 1e6 * position_m.squaredNorm()) * position_m;
}

TEST(SampleGate, PassesEverySampleOfAnElasticObjectAtOnce) {
  for (const double stiffer : {0.1, 1.0, 8.0}) {
    SampleGate gate(kMaxForce_N);
    for (int k = 0; k < 600; ++k) {
      const Vector3d p = hand_m(k * kPeriod_s);
      const Sample sample = sample_at(k * kPeriod_s, p, stiffer * spring_N(p));
      const auto passed = gate.pass(sample);
      ASSERT_EQ(passed.size(), 1u) << stiffer << ' ' << k;
      EXPECT_EQ(passed[0].force_W, sample.force_W);
    }
    EXPECT_EQ(gate.refused(), 0u);
  }
}

TEST(SampleGate, RefusesOutliersAndHardlyAnythingElse) {
  constexpr unsigned kSeed = 7;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> size(-2.0, 2.0);
  SampleGate gate(kMaxForce_N);
  int lies = 0;
  int passed_lies = 0;
  int references = 0;
  int passed_references = 0;
  for (int k = 0; k < 3000; ++k) {
    const Vector3d p = hand_m(k * kPeriod_s);
    Vector3d off_N = Vector3d::Zero();
    if (k > 30 && k % 20 == 0) {
      do {
        off_N = Vector3d(size(random), size(random), size(random));
      } while (off_N.norm() < 1.2);
      ++lies;
    } else {
      ++references;
    }
    for (const Sample& passed : gate.pass(sample_at(k * kPeriod_s, p, spring_N(p) + off_N))) {
      const bool lie = (passed.force_W - spring_N(passed.position_W)).norm() > 1e-12;
      (lie ? passed_lies : passed_references) += 1;
    }
  }
  // Wrong samples that happen to look like an object that gives way can't be detected; the samples
  // after them may then seem wrong.
  EXPECT_GT(passed_references, 0.998 * references);
  EXPECT_LT(passed_lies, 0.2 * lies);
  EXPECT_EQ(gate.refused(),
            static_cast<std::uint64_t>(lies - passed_lies + references - passed_references));
}

TEST(SampleGate, BelievesWhatGivesWayAtOnce) {
  SampleGate gate(kMaxForce_N);
  for (int k = 0; k < 120; ++k) {
    const Vector3d p = hand_m(k * kPeriod_s);
    const double left = k < 50 ? 1.0 : 0.4;  // the object is cut
    EXPECT_EQ(gate.pass(sample_at(k * kPeriod_s, p, left * spring_N(p))).size(), 1u) << k;
  }
}

TEST(SampleGate, BelievesAWallAtOnce) {
  for (const double wall_N_per_m : {300.0, 1000.0, 3000.0}) {
    SampleGate gate(kMaxForce_N);
    for (int k = 0; k < 300; ++k) {
      const Vector3d p = hand_m(k * kPeriod_s);
      Vector3d force_N = spring_N(p);
      force_N.z() -= wall_N_per_m * std::max(0.0, p.z() - 0.006);
      EXPECT_EQ(gate.pass(sample_at(k * kPeriod_s, p, force_N)).size(), 1u) << wall_N_per_m << k;
    }
  }
}

TEST(SampleGate, BelievesANewForceInAStillHandWhenItIsBorneOut) {
  SampleGate gate(kMaxForce_N);
  const Vector3d p(0.0, 0.0, 0.004);
  for (int k = 0; k < 10; ++k) {
    EXPECT_EQ(gate.pass(sample_at(k * kPeriod_s, p, spring_N(p))).size(), 1u);
  }
  // Another tool has moved the object.
  const Vector3d moved_N(1.5, 0.0, -2.0);
  EXPECT_EQ(gate.pass(sample_at(10 * kPeriod_s, p, moved_N)).size(), 0u);
  const auto both = gate.pass(sample_at(11 * kPeriod_s, p, moved_N));
  ASSERT_EQ(both.size(), 2u);
  EXPECT_EQ(both[0].time_s, 10 * kPeriod_s);
  EXPECT_EQ(both[1].time_s, 11 * kPeriod_s);
  EXPECT_EQ(gate.pass(sample_at(12 * kPeriod_s, p, moved_N)).size(), 1u);
  EXPECT_EQ(gate.refused(), 0u);
}

TEST(SampleGate, NeverBelievesForcesWrongByAHundredfold) {
  SampleGate gate(kMaxForce_N);
  std::uint64_t refused = 0;
  for (int k = 0; k < 600; ++k) {
    const Vector3d p = hand_m(k * kPeriod_s);
    const bool lies = k >= 100;
    for (const Sample& passed :
         gate.pass(sample_at(k * kPeriod_s, p, (lies ? 100.0 : 1.0) * spring_N(p)))) {
      EXPECT_LT(passed.force_W.norm(), kMaxForce_N) << k;
    }
    refused = gate.refused();
  }
  EXPECT_GT(refused, 450u);
  // And believes the first that is true again.
  const Vector3d p = hand_m(600 * kPeriod_s);
  EXPECT_EQ(gate.pass(sample_at(600 * kPeriod_s, p, spring_N(p))).size(), 1u);
}

TEST(SampleGate, StartsAnewWithEveryContact) {
  SampleGate gate(kMaxForce_N);
  const Vector3d p(0.0, 0.0, 0.004);
  for (int k = 0; k < 10; ++k) {
    gate.pass(sample_at(k * kPeriod_s, p, spring_N(p)));
  }
  gate.forget();
  EXPECT_EQ(gate.pass(sample_at(1.0, p, Vector3d(3.0, 0.0, 0.0))).size(), 1u);
}

TEST(SampleGate, LeavesWhatIsNotFiniteToTheMethod) {
  SampleGate gate(kMaxForce_N);
  const Vector3d p(0.0, 0.0, 0.004);
  gate.pass(sample_at(0.0, p, spring_N(p)));
  EXPECT_EQ(gate.pass(sample_at(0.1, p, Vector3d::Constant(std::nan("")))).size(), 1u);
  EXPECT_EQ(gate.pass(sample_at(0.2, p, spring_N(p))).size(), 1u);
}

}  // namespace
}  // namespace forcegrid
