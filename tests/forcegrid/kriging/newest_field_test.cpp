// SPDX-License-Identifier: Apache-2.0
// The newest sample extended by its slope, against the slopes of linear objects.

#include "forcegrid/kriging/newest_field.h"

#include <gtest/gtest.h>

#include <random>

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr unsigned kSeed = 5;

// dF/dP of a linear object: symmetric, pushing back.
Matrix3d slope_N_per_m() {
  Matrix3d slope;
  slope << -300.0, 40.0, -20.0, 40.0, -200.0, 10.0, -20.0, 10.0, -500.0;
  return slope;
}

Observation at(const Vector3d& position_m, std::uint64_t contact = 1) {
  Observation o;
  o.position_m = position_m;
  o.force_N = slope_N_per_m() * position_m;
  o.contact = contact;
  return o;
}

Vector3d read_N(const NewestField& field, const Vector3d& position_m) {
  return field.read(position_m, History::Zero()).force_N;
}

TEST(NewestField, ExtendsASampleByItsOwnStiffness) {
  NewestField field({});
  EXPECT_EQ(field.sample_count(), 0);
  Observation o = at(Vector3d(0.004, -0.002, 0.006));
  o.has_stiffness = true;
  for (int i = 0; i < 6; ++i) {
    o.stiffness_N_per_m[i] = slope_N_per_m()(kStiffnessRow[i], kStiffnessColumn[i]);
  }
  EXPECT_FALSE(field.take(o).predicted);
  EXPECT_EQ(field.sample_count(), 1);
  const Vector3d elsewhere_m(-0.01, 0.02, 0.003);
  EXPECT_LT((read_N(field, elsewhere_m) - slope_N_per_m() * elsewhere_m).norm(), 1e-12);
  EXPECT_EQ(field.stiffness_N_per_m(elsewhere_m, History::Zero()), slope_N_per_m());
}

TEST(NewestField, LearnsTheSlopeFromStepsInAllDirections) {
  NewestField field({});
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> place_m(-0.015, 0.015);
  for (int i = 0; i < 60; ++i) {
    field.take(at(Vector3d(place_m(random), place_m(random), place_m(random))));
  }
  const Matrix3d learnt = field.stiffness_N_per_m(Vector3d::Zero(), History::Zero());
  EXPECT_LT((learnt - slope_N_per_m()).norm(), 0.01 * slope_N_per_m().norm()) << "seed " << kSeed;
  EXPECT_LT(field.deviation_N(Vector3d::Zero(), History::Zero()), 0.1) << "seed " << kSeed;
}

// Steps of 0.1 mm with 17 mN of noise would be slopes of 170 N/m, and more for shorter ones.
TEST(NewestField, LearnsLittleFromNoiseAtRest) {
  NewestField field({});
  std::mt19937 random(kSeed);
  std::normal_distribution<double> noise_N(0.0, 0.01);
  std::normal_distribution<double> tremor_m(0.0, 0.03e-3);
  for (int i = 0; i < 300; ++i) {
    Observation o = at(Vector3d(tremor_m(random), tremor_m(random), tremor_m(random)));
    o.force_N = Vector3d(noise_N(random), noise_N(random), noise_N(random));
    field.take(o);
  }
  EXPECT_LT(field.stiffness_N_per_m(Vector3d::Zero(), History::Zero()).norm(), 40.0)
      << "seed " << kSeed;
}

TEST(NewestField, BeginsAContactWithNoForceAtItsPoint) {
  NewestField field({});
  field.take(at(Vector3d(0.01, 0.0, 0.0)));
  field.take(at(Vector3d(0.0, 0.01, 0.0)));
  field.enter_contact(2, Vector3d(0.1, 0.1, 0.1));
  EXPECT_EQ(read_N(field, Vector3d::Zero()), Vector3d(Vector3d::Zero()));
}

}  // namespace
}  // namespace forcegrid::kriging
