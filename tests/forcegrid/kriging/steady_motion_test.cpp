// SPDX-License-Identifier: Apache-2.0
// The motion that samples tell of, against least squares solved densely by Eigen.

#include "forcegrid/kriging/steady_motion.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr unsigned kSeed = 5;
constexpr int kSamples = 12;
constexpr int kRows = 3 * kSamples;
constexpr double kBegins_s = 2.0;

// Samples of a known field that moves: what they carry, and the forces relative to the field's.
struct Samples {
  MatrixXd columns_N{kRows, SteadyMotion::kUnknowns};
  VectorXd about_N{kRows}, error_N{kRows};
  MatrixXd covariance_N2;  // of the errors besides the motion

  explicit Samples(const SteadyMotion& motion, double noise_N, bool elsewhere = false) {
    std::mt19937 random(kSeed);
    std::normal_distribution<double> normal;
    const SteadyMotion::Vector eta =
        (SteadyMotion::Vector() << 2e-4, -1e-4, 3e-4, 1e-3, 2e-3, -1e-3).finished();
    MatrixXd mixed(kRows, kRows);
    for (int k = 0; k < kSamples; ++k) {
      const double time_s = kBegins_s + 0.1 * k;
      const Matrix3d half = Matrix3d::NullaryExpr([&] { return 10.0 * normal(random); });
      const Matrix3d slope_N_per_m = half * half.transpose();
      // A sample that was made linear elsewhere tells the same: its place differs by as much.
      const SteadyMotion::Vector about = elsewhere
                                             ? SteadyMotion::Vector(0.3 * k * eta)
                                             : SteadyMotion::Vector(SteadyMotion::Vector::Zero());
      const SteadyMotion::Terms terms_N = motion.terms(time_s, slope_N_per_m, about);
      columns_N.middleRows<3>(3 * k) = terms_N.leftCols<SteadyMotion::kUnknowns>();
      about_N.segment<3>(3 * k) = terms_N.col(SteadyMotion::kUnknowns);
      const Vector3d noise = noise_N * Vector3d::NullaryExpr([&] { return normal(random); });
      error_N.segment<3>(3 * k) =
          terms_N.leftCols<SteadyMotion::kUnknowns>() * (eta - about) + noise;
    }
    for (int r = 0; r < kRows; ++r) {
      for (int c = 0; c < kRows; ++c) {
        mixed(r, c) = normal(random);
      }
    }
    covariance_N2 = noise_N * noise_N *
                    (MatrixXd::Identity(kRows, kRows) + 0.1 / kRows * mixed * mixed.transpose());
  }

  SteadyMotion::Products products() const {
    MatrixXd all(kRows, SteadyMotion::kTerms + 1);
    all << columns_N, about_N, error_N;
    return all.transpose() * covariance_N2.llt().solve(all);
  }
};

SteadyMotion::Covariance wide() {
  SteadyMotion::Covariance covariance = SteadyMotion::Covariance::Zero();
  covariance.diagonal() << Vector3d::Constant(1e-6), Vector3d::Constant(1e-4);
  return covariance;
}

SteadyMotion begun() {
  SteadyMotion motion;
  motion.begin(kBegins_s, Vector3d(1e-3, 0.0, 0.0), Vector3d(0.0, 5e-3, 0.0), wide());
  return motion;
}

TEST(SteadyMotion, IsTheGeneralisedLeastSquaresOfItsSamples) {
  SteadyMotion motion = begun();
  const Samples samples(motion, 1e-3);
  ASSERT_TRUE(motion.fit(samples.products(), kRows));
  const MatrixXd weighted = samples.covariance_N2.llt().solve(samples.columns_N);
  const MatrixXd information =
      samples.columns_N.transpose() * weighted + MatrixXd(wide()).inverse();
  const VectorXd expected = information.ldlt().solve(weighted.transpose() * samples.error_N);
  EXPECT_LT((motion.eta() - expected).norm(), 1e-6 * expected.norm()) << "seed " << kSeed;
  EXPECT_LT((motion.covariance() * information - MatrixXd::Identity(6, 6)).norm(), 1e-4);
  // What is left of the squares is that of the fit, and of the prior.
  const VectorXd left_N = samples.error_N - samples.columns_N * expected;
  const double left = left_N.dot(samples.covariance_N2.llt().solve(left_N)) +
                      expected.dot(wide().inverse() * expected);
  const double all = samples.error_N.dot(samples.covariance_N2.llt().solve(samples.error_N));
  EXPECT_NEAR(motion.explained_squares(), all - left, 1e-6 * all);
}

TEST(SteadyMotion, IsTheSameWhereverItsSamplesAreLinear) {
  SteadyMotion here = begun();
  SteadyMotion elsewhere = begun();
  ASSERT_TRUE(here.fit(Samples(here, 1e-3).products(), kRows));
  ASSERT_TRUE(elsewhere.fit(Samples(elsewhere, 1e-3, true).products(), kRows));
  EXPECT_LT((here.eta() - elsewhere.eta()).norm(), 1e-6 * here.eta().norm()) << "seed " << kSeed;
}

TEST(SteadyMotion, IsLessCertainWhereItsSamplesDisagree) {
  SteadyMotion motion = begun();
  Samples samples(motion, 1e-3);
  ASSERT_TRUE(motion.fit(samples.products(), kRows));
  const double alike_m2 = motion.covariance()(0, 0);
  samples.covariance_N2 /= 100.0;  // ten times as much noise as is expected
  ASSERT_TRUE(motion.fit(samples.products(), kRows));
  EXPECT_GT(motion.covariance()(0, 0), 0.5 * alike_m2);
}

TEST(SteadyMotion, GoesOnFromWhereItBegan) {
  const SteadyMotion motion = begun();
  EXPECT_LT(
      (motion.shift_m(kBegins_s + 0.5, SteadyMotion::Vector::Zero()) - Vector3d(1e-3, 2.5e-3, 0.0))
          .norm(),
      1e-12);
  // In half a second 10 mm/s of the velocity's deviation add 5 mm to the shift's 1 mm.
  EXPECT_NEAR(std::sqrt(motion.covariance_at(kBegins_s + 0.5)(0, 0)), std::hypot(1e-3, 5e-3), 1e-9);
}

TEST(SteadyMotion, SaysThatNothingFits) {
  SteadyMotion motion = begun();
  SteadyMotion::Products products = Samples(motion, 1e-3).products();
  products(0, SteadyMotion::kTerms) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(motion.fit(products, kRows));
}

}  // namespace
}  // namespace forcegrid::kriging
