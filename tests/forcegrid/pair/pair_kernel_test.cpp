// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_kernel.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>
#include <vector>

#include "forcegrid/pair/pair_simd.h"
#include "tests/forcegrid/pair/series_springs.h"

namespace forcegrid::pair {
namespace {

constexpr unsigned kSeed = 7;
constexpr double kReach_m = 0.015;
constexpr double kStep_m = 1e-5;

class PairKernelTest : public ::testing::Test {
 protected:
  PairKernelTest() { RecordProperty("seed", static_cast<int>(kSeed)); }
  const PairKernel kernel_;
  testing::RandomPositions positions_{kSeed, kReach_m};
};

// Its definition: minus the second derivatives of psi, by central differences of the scalar.
TEST_F(PairKernelTest, IsTheSecondDerivativeOfThePotentialsCovariance) {
  PairKernel radial;
  radial.stiffness_prior = 0.0;
  radial.constant_N2 = 0.0;
  const double l2 = radial.length_m * radial.length_m;
  const auto psi = [&](const PairVector& d) { return l2 * std::exp(-0.5 * d.squaredNorm() / l2); };
  constexpr double kWide_m = 1e-4;
  for (int i = 0; i < 20; ++i) {
    const PairVector p = positions_.next();
    const PairVector q = positions_.next();
    const Matrix6 exact = radial.force_force(p, q);
    for (int a = 0; a < 6; ++a) {
      for (int b = 0; b < 6; ++b) {
        const PairVector u = kWide_m * PairVector::Unit(a);
        const PairVector v = kWide_m * PairVector::Unit(b);
        const PairVector d = p - q;
        // Cov(F_a(p), F_b(q)) = d/dp_a d/dq_b psi(p - q).
        const double numeric =
            -(psi(d + u + v) - psi(d + u - v) - psi(d - u + v) + psi(d - u - v)) /
            (4.0 * kWide_m * kWide_m);
        EXPECT_NEAR(exact(a, b), numeric, 1e-4) << a << ' ' << b;
      }
    }
  }
}

// A random symmetric stiffness A with E[A_ae A_bc] = s2 (1/2 (D_ab D_ce + D_ac D_be) + D_ae D_bc).
TEST_F(PairKernelTest, HasTheCovarianceOfALinearForceOfRandomSymmetricStiffness) {
  PairKernel plain;
  plain.stiffness_prior = 0.0;
  const auto same = [](int x, int y) { return x == y ? 1.0 : 0.0; };
  for (int i = 0; i < 5; ++i) {
    const PairVector p = positions_.next();
    const PairVector q = positions_.next();
    const Matrix6 linear = kernel_.force_force(p, q) - plain.force_force(p, q);
    for (int a = 0; a < 6; ++a) {
      for (int b = 0; b < 6; ++b) {
        double sum = 0.0;
        for (int e = 0; e < 6; ++e) {
          for (int c = 0; c < 6; ++c) {
            sum += p[e] * q[c] *
                   (0.5 * (same(a, b) * same(c, e) + same(a, c) * same(b, e)) +
                    same(a, e) * same(b, c));
          }
        }
        EXPECT_NEAR(linear(a, b), kernel_.stiffness_variance() * sum, 1e-9);
      }
    }
  }
}

TEST_F(PairKernelTest, HasNoCurlAcrossTheTools) {
  for (int i = 0; i < 20; ++i) {
    const PairVector p = positions_.next();
    const PairVector q = positions_.next();
    std::array<Matrix6, 6> slope;  // along p_c
    double scale = 0.0;
    for (int c = 0; c < 6; ++c) {
      const PairVector step = kStep_m * PairVector::Unit(c);
      slope[static_cast<std::size_t>(c)] =
          (kernel_.force_force(p + step, q) - kernel_.force_force(p - step, q)) / (2.0 * kStep_m);
      scale += slope[static_cast<std::size_t>(c)].norm();
    }
    for (std::size_t c = 0; c < 6; ++c) {
      for (std::size_t a = 0; a < 6; ++a) {
        EXPECT_LT((slope[c].row(static_cast<int>(a)) - slope[a].row(static_cast<int>(c))).norm(),
                  1e-7 * scale);
      }
    }
  }
}

// Cov(F_a(p), J_bc(q)) = d/dq_c Cov(F_a(p), F_b(q)), by central differences.
TEST_F(PairKernelTest, HasTheStiffnessOfAFieldAsItsDerivative) {
  for (int i = 0; i < 10; ++i) {
    const PairVector p = positions_.next();
    const PairVector q = positions_.next();
    for (int n = 0; n < kStiffnessNumbers; ++n) {
      const int b = kStiffnessRow[n];
      const int c = kStiffnessColumn[n];
      const PairVector step = kStep_m * PairVector::Unit(c);
      const PairVector slope =
          (kernel_.force_force(p, q + step) - kernel_.force_force(p, q - step)).col(b) /
          (2.0 * kStep_m);
      const int part = n / 6;
      EXPECT_LT((kernel_.force_stiffness(p, q, part).col(n - part_begin(part)) - slope).norm(),
                1e-3)  // of some 1e4 N^2/m
          << n;
    }
  }
}

// Cov(J_ae(p), J_bc(q)) = d/dp_e Cov(F_a(p), J_bc(q)).
TEST_F(PairKernelTest, HasTheCovarianceOfTwoStiffnessesAsItsDerivative) {
  for (int i = 0; i < 10; ++i) {
    const PairVector p = positions_.next();
    const PairVector q = positions_.next();
    for (int part_q = 0; part_q < kStiffnessParts; ++part_q) {
      std::array<Matrix6, 6> slope;  // along p_e
      for (int e = 0; e < 6; ++e) {
        const PairVector step = kStep_m * PairVector::Unit(e);
        slope[static_cast<std::size_t>(e)] = (kernel_.force_stiffness(p + step, q, part_q) -
                                              kernel_.force_stiffness(p - step, q, part_q)) /
                                             (2.0 * kStep_m);
      }
      for (int n = 0; n < kStiffnessNumbers; ++n) {
        const int part_p = n / 6;
        const Matrix6 exact = kernel_.stiffness_stiffness(p, part_p, q, part_q);
        const auto& expected = slope[static_cast<std::size_t>(kStiffnessColumn[n])];
        EXPECT_LT((exact.row(n - part_begin(part_p)) - expected.row(kStiffnessRow[n])).norm(), 0.1)
            << n;  // of some 1e6 N^2/m^2
      }
    }
  }
}

TEST_F(PairKernelTest, MakesPositiveSemidefiniteMatrices) {
  constexpr int kSamples = 24;
  std::vector<PairVector> at;
  for (int i = 0; i < kSamples; ++i) {
    at.push_back(positions_.next());
  }
  Eigen::MatrixXd k(6 * kSamples, 6 * kSamples);
  for (int i = 0; i < kSamples; ++i) {
    for (int j = 0; j < kSamples; ++j) {
      k.block<6, 6>(6 * i, 6 * j) =
          kernel_.force_force(at[static_cast<std::size_t>(i)], at[static_cast<std::size_t>(j)]);
    }
  }
  EXPECT_LT((k - k.transpose()).norm(), 1e-12 * k.norm());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(k);
  EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-12 * eigen.eigenvalues().maxCoeff());
}

// The lanes against plain loops, for every number of groups that a dictionary can have.
TEST_F(PairKernelTest, SumsTheSameInLanesAndInPlainLoops) {
  constexpr int kStride = 48;
  alignas(64) static std::array<float, 12 * kStride> rows;
  testing::RandomPositions unit(kSeed, 1.5);
  for (int samples = kPairLanes; samples <= kStride; samples += kPairLanes) {
    for (int i = 0; i < kStride; ++i) {
      const PairVector position = unit.next();
      const PairVector weight = unit.next();
      for (int a = 0; a < 6; ++a) {
        rows[static_cast<std::size_t>(a * kStride + i)] = static_cast<float>(position[a]);
        rows[static_cast<std::size_t>((6 + a) * kStride + i)] = static_cast<float>(weight[a]);
      }
    }
    const Eigen::Matrix<float, 6, 1> p = unit.next().cast<float>();
    const PairTerms terms{rows.data(), kStride, samples};
    const PairSum lanes = pair_sum(terms, p.data());
    const PairSum plain = pair_sum_scalar(terms, p.data());
    for (int a = 0; a < 6; ++a) {
      EXPECT_NEAR(lanes.force_N[a], plain.force_N[a], 3e-5F) << samples;  // of sums of order 1
    }
    EXPECT_NEAR(lanes.nearest2, plain.nearest2, 1e-5F);
  }
}

TEST_F(PairKernelTest, SumsTheSameOfStiffnessInLanesAndInPlainLoops) {
  constexpr int kStride = 16;
  alignas(64) static std::array<float, 12 * kStride> rows;
  alignas(64) static std::array<float, (6 + kStiffnessNumbers) * kPairFewLanes> few;
  testing::RandomPositions unit(kSeed, 1.5);
  for (int count = 1; count <= kPairFewLanes; ++count) {
    few.fill(0.0F);
    for (int i = 0; i < count; ++i) {
      for (std::size_t row = 0; row < 6 + kStiffnessNumbers; ++row) {
        few[row * kPairFewLanes + static_cast<std::size_t>(i)] = static_cast<float>(unit.next()[0]);
      }
    }
    const Eigen::Matrix<float, 6, 1> p = unit.next().cast<float>();
    const PairTerms terms{rows.data(), kStride, kStride, few.data(), count};
    const PairSum lanes = pair_sum(terms, p.data());
    const PairSum plain = pair_sum_scalar(terms, p.data());
    for (int a = 0; a < 6; ++a) {
      EXPECT_NEAR(lanes.force_N[a], plain.force_N[a], 1e-4F) << count;  // of sums of order 10
    }
  }
}

}  // namespace
}  // namespace forcegrid::pair
