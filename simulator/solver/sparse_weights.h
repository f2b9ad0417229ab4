// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <vector>

namespace forcegrid::simulator {

/// A few columns of a matrix with positive weights whose sum is near a given vector.
struct SparseWeights {
  std::vector<int> column;
  std::vector<double> weight;  ///< > 0
  double residual = 0.0;       ///< |G w - b|
};

/// Non-negative least squares, ended early so that few columns are used: min |G w - b|, w >= 0.
/// Lawson and Hanson's active set: adds the columns that point most along the residual, several at
/// once, and removes those whose weight would become negative.
/// Source: Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23; as the sparse
/// cubature of Farhat, Avery, Chapman and Cortial (2014).
/// @param aim  ends at this residual |G w - b|.
/// @param most_columns  ends at this many columns, too.
/// @param cancel  null, or ends the search when true.
/// Real-time: no.
SparseWeights find_sparse_weights(const Eigen::MatrixXd& columns, const Eigen::VectorXd& sum,
                                  double aim, int most_columns,
                                  const std::atomic<bool>* cancel = nullptr);

}  // namespace forcegrid::simulator
