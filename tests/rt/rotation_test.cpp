// SPDX-License-Identifier: Apache-2.0
#include "rt/rotation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace forcegrid::rt {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

void expect_near(const Vector3d& actual, const Vector3d& expected, double within) {
  EXPECT_LE((actual - expected).norm(), within)
      << actual.transpose() << " expected " << expected.transpose();
}

TEST(RotationVector, IsEigensAngleAndAxisTheShorterWay) {
  constexpr unsigned kSeed = 3;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 500; ++i) {
    const Quaterniond from =
        Quaterniond(normal(random), normal(random), normal(random), normal(random)).normalized();
    const Vector3d axis = Vector3d(normal(random), normal(random), normal(random)).normalized();
    const double angle_rad = std::abs(std::fmod(normal(random), M_PI));
    const Quaterniond to = Quaterniond(AngleAxisd(angle_rad, axis)) * from;
    expect_near(rotation_vector_rad(from, to), angle_rad * axis, 1e-12);
    expect_near(rotation_vector_rad(from, Quaterniond(-to.coeffs())), angle_rad * axis, 1e-12);
  }
  expect_near(rotation_vector_rad(Quaterniond::Identity(), Quaterniond::Identity()),
              Vector3d::Zero(), 0.0);
}

}  // namespace
}  // namespace forcegrid::rt
