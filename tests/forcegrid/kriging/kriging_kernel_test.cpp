// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_kernel.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <random>
#include <vector>

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr unsigned kSeed = 21;
const History kNoHistory = History::Zero();

struct Named {
  const char* name;
  RadialShape shape;
};

class KernelShapes : public ::testing::TestWithParam<Named> {
 protected:
  KernelShapes() {
    kernel_.shape = GetParam().shape;
    RecordProperty("seed", static_cast<int>(kSeed));
  }
  Vector3d point() {
    return 0.02 * Vector3d(uniform_(random_), uniform_(random_), uniform_(random_));
  }
  // dF/dq_c of the force's covariance, the difference quotient that Cov(F, J) must be.
  Matrix3d slope_of_force_force(const Vector3d& p, const Vector3d& q, int c) const {
    const Vector3d step = kStep_m * Vector3d::Unit(c);
    return (kernel_.force_force(p, kNoHistory, q + step, kNoHistory) -
            kernel_.force_force(p, kNoHistory, q - step, kNoHistory)) /
           (2.0 * kStep_m);
  }

  static constexpr double kStep_m = 1e-6;
  Kernel kernel_;
  std::mt19937 random_{kSeed};
  std::uniform_real_distribution<double> uniform_{-1.0, 1.0};
};

TEST_P(KernelShapes, HasOneNewtonOfRadialVarianceAtASample) {
  kernel_.stiffness_prior = 0.0;
  kernel_.constant_N2 = 0.0;
  const Vector3d p = point();
  EXPECT_TRUE(kernel_.force_force(p, kNoHistory, p, kNoHistory).isApprox(Matrix3d::Identity()));
}

TEST_P(KernelShapes, IsSymmetricUnderExchangeOfItsArguments) {
  for (int i = 0; i < 20; ++i) {
    const Vector3d p = point();
    const Vector3d q = point();
    EXPECT_TRUE(kernel_.force_force(p, kNoHistory, q, kNoHistory)
                    .isApprox(kernel_.force_force(q, kNoHistory, p, kNoHistory).transpose()));
    EXPECT_TRUE(kernel_.stiffness_stiffness(p, q).isApprox(
        kernel_.stiffness_stiffness(q, p).transpose(), 1e-12));
  }
}

TEST_P(KernelShapes, HasNoCurl) {
  for (int i = 0; i < 20; ++i) {
    const Vector3d p = point();
    const Vector3d q = point();
    std::array<Matrix3d, 3> slope;  // of the columns of Cov(F(p), F(q)) along p_c
    for (int c = 0; c < 3; ++c) {
      const Vector3d step = kStep_m * Vector3d::Unit(c);
      slope[static_cast<std::size_t>(c)] =
          (kernel_.force_force(p + step, kNoHistory, q, kNoHistory) -
           kernel_.force_force(p - step, kNoHistory, q, kNoHistory)) /
          (2.0 * kStep_m);
    }
    const double scale = slope[0].norm() + slope[1].norm() + slope[2].norm();
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t a = 0; a < 3; ++a) {
        EXPECT_LT((slope[c].row(static_cast<int>(a)) - slope[a].row(static_cast<int>(c))).norm(),
                  1e-7 * scale);  // rounding of the difference quotients
      }
    }
  }
}

TEST_P(KernelShapes, CovariesForceWithStiffnessAsItsDerivative) {
  for (int i = 0; i < 20; ++i) {
    const Vector3d p = point();
    const Vector3d q = point();
    const Matrix36d exact = kernel_.force_stiffness(p, q);
    for (int k = 0; k < 6; ++k) {
      const int b = kStiffnessRow[k];
      const int c = kStiffnessColumn[k];
      // J_bc = dF_b/dq_c: column b of the slope along q_c; symmetric, so also the other way round.
      const Vector3d along_c = slope_of_force_force(p, q, c).col(b);
      const Vector3d along_b = slope_of_force_force(p, q, b).col(c);
      EXPECT_LT((exact.col(k) - along_c).norm(), 1e-6 * exact.norm()) << k;
      EXPECT_LT((exact.col(k) - along_b).norm(), 1e-6 * exact.norm()) << k;
    }
  }
}

TEST_P(KernelShapes, CovariesStiffnessWithStiffnessAsTheSecondDerivative) {
  for (int i = 0; i < 20; ++i) {
    const Vector3d p = point();
    const Vector3d q = point();
    const Matrix6d exact = kernel_.stiffness_stiffness(p, q);
    for (int k = 0; k < 6; ++k) {
      const int a = kStiffnessRow[k];
      const int e = kStiffnessColumn[k];
      const Vector3d step = kStep_m * Vector3d::Unit(e);
      const Eigen::Matrix<double, 1, 6> slope = (kernel_.force_stiffness(p + step, q).row(a) -
                                                 kernel_.force_stiffness(p - step, q).row(a)) /
                                                (2.0 * kStep_m);
      EXPECT_LT((exact.row(k) - slope).norm(), 1e-6 * exact.norm()) << k;
    }
  }
}

// Forces and stiffnesses of the same field can't have arbitrary covariances.
TEST_P(KernelShapes, MakesPositiveDefiniteMatricesOfForcesAndStiffnesses) {
  constexpr int kForces = 10;
  constexpr int kStiffnesses = 4;
  constexpr int kRows = 3 * kForces + 6 * kStiffnesses;
  for (int trial = 0; trial < 5; ++trial) {
    std::vector<Vector3d> at;
    for (int i = 0; i < kForces + kStiffnesses; ++i) {
      at.push_back(point());
    }
    at[kForces] = at[0];  // a sample with both
    Eigen::MatrixXd k(kRows, kRows);
    for (int i = 0; i < kForces; ++i) {
      for (int j = 0; j < kForces; ++j) {
        k.block<3, 3>(3 * i, 3 * j) =
            kernel_.force_force(at[static_cast<std::size_t>(i)], kNoHistory,
                                at[static_cast<std::size_t>(j)], kNoHistory);
      }
      for (int j = 0; j < kStiffnesses; ++j) {
        k.block<3, 6>(3 * i, 3 * kForces + 6 * j) = kernel_.force_stiffness(
            at[static_cast<std::size_t>(i)], at[static_cast<std::size_t>(kForces + j)]);
        k.block<6, 3>(3 * kForces + 6 * j, 3 * i) =
            k.block<3, 6>(3 * i, 3 * kForces + 6 * j).transpose();
      }
    }
    for (int i = 0; i < kStiffnesses; ++i) {
      for (int j = 0; j < kStiffnesses; ++j) {
        k.block<6, 6>(3 * kForces + 6 * i, 3 * kForces + 6 * j) = kernel_.stiffness_stiffness(
            at[static_cast<std::size_t>(kForces + i)], at[static_cast<std::size_t>(kForces + j)]);
      }
    }
    // Stiffness in units of 100 N/m, so that rounding is of one size in all rows.
    k.bottomRows(6 * kStiffnesses) *= 0.01;
    k.rightCols(6 * kStiffnesses) *= 0.01;
    EXPECT_LT((k - k.transpose()).norm(), 1e-12 * k.norm());
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(k);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-13 * eigen.eigenvalues().maxCoeff());
  }
}

TEST_P(KernelShapes, GivesTheMeanDiagonalOfItsOwnMatrixAsPriorVariance) {
  kernel_.history_gain = 0.3;
  History h = History::Constant(0.002);
  for (int i = 0; i < 5; ++i) {
    const Vector3d p = point();
    EXPECT_NEAR(kernel_.prior_variance_N2(p, h), kernel_.force_force(p, h, p, h).trace() / 3.0,
                1e-9);
  }
}

TEST_P(KernelShapes, CovariesHistoriesByTheirInnerProduct) {
  const Vector3d p = point();
  const Vector3d q = point();
  History hp = History::Zero();
  History hq = History::Zero();
  hp.col(1) = Vector3d(0.001, 0.002, 0.0);
  hq.col(1) = Vector3d(0.003, 0.0, 0.004);
  const Matrix3d without = kernel_.force_force(p, hp, q, hq);
  kernel_.history_gain = 0.03;
  // 0.03 * 9 / (30 mm)^2 * 3e-6 m^2 = 9e-4 N^2
  EXPECT_TRUE(
      (kernel_.force_force(p, hp, q, hq) - without).isApprox(9e-4 * Matrix3d::Identity(), 1e-9));
}

INSTANTIATE_TEST_SUITE_P(Shapes, KernelShapes,
                         ::testing::Values(Named{"squared_exponential",
                                                 RadialShape::kSquaredExponential},
                                           Named{"matern_7_2", RadialShape::kMatern72}),
                         [](const auto& parameter) { return parameter.param.name; });

}  // namespace
}  // namespace forcegrid::kriging
