// SPDX-License-Identifier: Apache-2.0
// Dictionaries of few samples (kriging_field.h, "Dictionary"; sample_spacing.h).
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/sample_spacing.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;
using Plain = DictionaryField<double, 32, 0>;

const History kNoHistory = History::Zero();
constexpr double kEncoder_m = 23e-6;

FieldSettings with(int few_samples) {
  FieldSettings settings;
  settings.nugget_N2 = 1e-6;
  settings.few_samples = few_samples;
  return settings;
}

Vector3d spring_N(const Vector3d& p_m) {
  return {-40.0 * p_m.x(), -50.0 * p_m.y(), -80.0 * p_m.z()};
}

// A tool that swings by a quarter of a millimetre, as an encoder sees it.
Vector3d swing_m(double time_s) {
  const double turn = 2.0 * std::numbers::pi * time_s;
  const Vector3d at_m = 0.25e-3 * Vector3d(std::sin(1.3 * turn), std::sin(1.7 * turn + 1.0),
                                           std::sin(0.9 * turn + 2.0));
  return kEncoder_m * (at_m / kEncoder_m).array().round().matrix();
}

Observation at(const Vector3d& position_m, const Vector3d& noise_N = Vector3d::Zero()) {
  Observation sample;
  sample.position_m = position_m;
  sample.force_N = spring_N(position_m) + noise_N;
  return sample;
}

TEST(SpacingOfFew, TellsForcesApartByHalfAtLeast) {
  const SampleSpacing spacing{1e-3, 0.1};
  const SampleSpacing few = spacing.of_few(0.25);
  const auto apart = [&few](double moved_m, double changed_N) {
    return few.apart(few.distance_m2(moved_m * moved_m, changed_N * changed_N));
  };
  EXPECT_TRUE(apart(0.251e-3, 0.0));
  EXPECT_FALSE(apart(0.249e-3, 0.0));
  EXPECT_TRUE(apart(0.0, 0.051));
  EXPECT_FALSE(apart(0.0, 0.049));
  const SampleSpacing all = spacing.of_few(1.0);
  EXPECT_DOUBLE_EQ(all.metres, spacing.metres);
  EXPECT_DOUBLE_EQ(all.newtons, spacing.newtons);
}

// How wrong the stiffness is in which a tool swings, relative to the spring's, after some seconds.
double stiffness_error(int few_samples) {
  Plain field(with(few_samples));
  for (int i = 0; i < 150; ++i) {
    field.take(at(swing_m(i / 30.0)));
  }
  Eigen::Matrix3d exact = Eigen::Matrix3d::Zero();
  exact.diagonal() << -40.0, -50.0, -80.0;
  return (field.stiffness_N_per_m(Vector3d::Zero(), kNoHistory) - exact).norm() / exact.norm();
}

TEST(FewSamples, TellTheStiffnessOfASmallMotion) {
  EXPECT_LT(stiffness_error(8), 0.1);
  EXPECT_GT(stiffness_error(1), 0.3);
}

TEST(FewSamples, AreWellApartOnceThereAreMore) {
  const auto samples_of = [](int few_samples, double size_m) {
    Plain field(with(few_samples));
    for (int i = 0; i < 600; ++i) {
      field.take(at(size_m / 0.25e-3 * swing_m(i / 30.0)));
    }
    return field.sample_count();
  };
  EXPECT_LE(samples_of(8, 0.25e-3), 9) << "eight, and the newest";
  EXPECT_GE(samples_of(8, 0.25e-3), 5) << "a stiffness takes four";
  EXPECT_LE(samples_of(1, 0.25e-3), 3);
  EXPECT_EQ(samples_of(8, 10e-3), 32) << "full";
}

// A tool at rest, whose simulator has ten times the noise that the field expects: they differ by
// less than half of the spacing's force, and would tell slopes that are none.
TEST(FewSamples, AreNotFilledByNoise) {
  Plain field(with(8));
  for (int i = 0; i < 100; ++i) {
    field.take(at(Vector3d::Zero(), 0.01 * Vector3d(std::sin(7.0 * i), std::sin(11.0 * i), 0.0)));
  }
  EXPECT_LE(field.sample_count(), 2);
}

}  // namespace
}  // namespace forcegrid::kriging
