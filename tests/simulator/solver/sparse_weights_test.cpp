// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/sparse_weights.h"

#include <gtest/gtest.h>

#include <random>

namespace forcegrid::simulator {
namespace {

constexpr std::uint64_t kSeed = 20;

Eigen::MatrixXd random_columns(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  std::mt19937_64 numbers(seed);
  std::normal_distribution<double> normal;
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(numbers); });
}

Eigen::VectorXd weights_of(const SparseWeights& found, Eigen::Index columns) {
  Eigen::VectorXd weight = Eigen::VectorXd::Zero(columns);
  for (std::size_t k = 0; k < found.column.size(); ++k) {
    weight[found.column[k]] += found.weight[k];
  }
  return weight;
}

TEST(SparseWeights, FindsTheFewColumnsThatASumWasMadeOf) {
  const Eigen::MatrixXd columns = random_columns(60, 300, kSeed);
  Eigen::VectorXd made = Eigen::VectorXd::Zero(300);
  for (int k = 0; k < 6; ++k) {
    made[17 + 41 * k] = 0.5 + k;
  }
  const SparseWeights found = find_sparse_weights(columns, columns * made, 1e-9, 60);
  SCOPED_TRACE(kSeed);
  EXPECT_EQ(found.column.size(), 6U);
  EXPECT_LT((weights_of(found, 300) - made).norm(), 1e-7);
  EXPECT_LE(found.residual, 1e-9);
}

// Kuhn and Tucker: at the least |G w - b| over w >= 0 no unused column points along what is left,
// and the used ones stand at right angles to it.
TEST(SparseWeights, WithoutAnAimItIsTheNonNegativeLeastSquaresSolution) {
  for (std::uint64_t seed = kSeed; seed < kSeed + 20; ++seed) {
    SCOPED_TRACE(seed);
    const Eigen::MatrixXd columns = random_columns(12, 8, seed);
    const Eigen::VectorXd sum = random_columns(12, 1, seed + 1000);
    const SparseWeights found = find_sparse_weights(columns, sum, 0.0, 8);
    const Eigen::VectorXd weight = weights_of(found, 8);
    const Eigen::VectorXd residual = sum - columns * weight;
    EXPECT_NEAR(found.residual, residual.norm(), 1e-12);
    const Eigen::VectorXd along = columns.transpose() * residual;
    EXPECT_GE(weight.minCoeff(), 0.0);
    for (Eigen::Index k = 0; k < 8; ++k) {
      EXPECT_LT(along[k], 1e-8);
      EXPECT_LT(std::abs(along[k] * weight[k]), 1e-8);
    }
  }
}

TEST(SparseWeights, EndsAtItsAimAndAtItsMostColumns) {
  const Eigen::MatrixXd columns = random_columns(80, 400, kSeed).cwiseAbs();
  const Eigen::VectorXd sum = columns.rowwise().sum();
  const SparseWeights coarse = find_sparse_weights(columns, sum, 0.05 * sum.norm(), 80);
  const SparseWeights fine = find_sparse_weights(columns, sum, 0.01 * sum.norm(), 80);
  EXPECT_LE(coarse.residual, 0.05 * sum.norm());
  EXPECT_LE(fine.residual, 0.01 * sum.norm());
  EXPECT_LT(coarse.column.size(), fine.column.size());
  EXPECT_LE(find_sparse_weights(columns, sum, 0.0, 5).column.size(), 5U);
  EXPECT_EQ(find_sparse_weights(Eigen::MatrixXd(80, 0), sum, 0.0, 5).residual, sum.norm());
  const std::atomic<bool> cancel{true};
  EXPECT_TRUE(find_sparse_weights(columns, sum, 0.0, 80, &cancel).column.empty());
}

}  // namespace
}  // namespace forcegrid::simulator
