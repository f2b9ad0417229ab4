// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/sparse_weights.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdint>
#include <limits>
#include <numeric>

namespace forcegrid::simulator {
namespace {

constexpr int kMostAtOnce = 8;
// Columns added together point along the residual at least this fraction as much as the best one.
constexpr double kNearlyBest = 0.6;
constexpr double kRidge = 1e-13;  // of the largest diagonal element
// Rounds that add nothing to the set end the search.
constexpr int kMostIdleRounds = 3;

class ActiveSet {
 public:
  ActiveSet(const Eigen::MatrixXd& columns, const Eigen::VectorXd& sum, int most)
      : columns_(columns),
        sum_(sum),
        most_(std::min<Eigen::Index>(most, columns.cols())),
        chosen_(columns.rows(), most_),
        gram_(most_, most_),
        right_side_(most_),
        used_(static_cast<std::size_t>(columns.cols()), 0),
        residual_(sum) {}

  const Eigen::VectorXd& residual() const { return residual_; }
  Eigen::Index size() const { return size_; }
  bool full() const { return size_ >= most_; }
  bool uses(Eigen::Index column) const { return used_[static_cast<std::size_t>(column)] != 0; }

  void add(Eigen::Index column) {
    used_[static_cast<std::size_t>(column)] = 1;
    member_.push_back(column);
    weight_.push_back(0.0);
    chosen_.col(size_) = columns_.col(column);
    gram_.col(size_).head(size_ + 1) = chosen_.leftCols(size_ + 1).transpose() * chosen_.col(size_);
    gram_.row(size_).head(size_ + 1) = gram_.col(size_).head(size_ + 1).transpose();
    right_side_[size_] = chosen_.col(size_).dot(sum_);
    ++size_;
  }

  // The best weights that are all positive, dropping columns on the way there.
  void settle() {
    while (size_ > 0) {
      const Eigen::VectorXd best = solve();
      double share = 1.0;  // of the way from the present weights
      for (Eigen::Index k = 0; k < size_; ++k) {
        const double now = weight_[static_cast<std::size_t>(k)];
        if (best[k] <= 0.0) {
          share = std::min(share, now / (now - best[k] + std::numeric_limits<double>::min()));
        }
      }
      for (Eigen::Index k = 0; k < size_; ++k) {
        double& now = weight_[static_cast<std::size_t>(k)];
        now += share * (best[k] - now);
      }
      if (share >= 1.0 && best.minCoeff() > 0.0) {
        break;
      }
      drop_where(best);
    }
    Eigen::Map<const Eigen::VectorXd> weights(weight_.data(), size_);
    residual_ = sum_ - chosen_.leftCols(size_) * weights;
  }

  SparseWeights result() const {
    SparseWeights found;
    for (std::size_t k = 0; k < member_.size(); ++k) {
      found.column.push_back(static_cast<int>(member_[k]));
      found.weight.push_back(weight_[k]);
    }
    found.residual = residual_.norm();
    return found;
  }

 private:
  Eigen::VectorXd solve() const {
    Eigen::MatrixXd matrix = gram_.topLeftCorner(size_, size_);
    const double ridge = kRidge * matrix.diagonal().maxCoeff();
    matrix.diagonal().array() += ridge;
    return matrix.llt().solve(right_side_.head(size_));
  }

  // Removes columns at zero whose best weight isn't positive; at least one.
  void drop_where(const Eigen::VectorXd& best) {
    constexpr double kZero = 1e-12;
    const double largest = *std::max_element(weight_.begin(), weight_.end());
    Eigen::Index smallest = 0;
    for (Eigen::Index k = 0; k < size_; ++k) {
      if (best[k] <= 0.0 &&
          (best[smallest] > 0.0 ||
           weight_[static_cast<std::size_t>(k)] < weight_[static_cast<std::size_t>(smallest)])) {
        smallest = k;
      }
    }
    Eigen::Index kept = 0;
    for (Eigen::Index k = 0; k < size_; ++k) {
      const auto at = static_cast<std::size_t>(k);
      if (k == smallest || (best[k] <= 0.0 && weight_[at] <= kZero * largest)) {
        used_[static_cast<std::size_t>(member_[at])] = 0;
        continue;
      }
      move(k, kept++);
    }
    size_ = kept;
    member_.resize(static_cast<std::size_t>(size_));
    weight_.resize(static_cast<std::size_t>(size_));
  }

  void move(Eigen::Index from, Eigen::Index to) {
    if (from == to) {
      return;
    }
    member_[static_cast<std::size_t>(to)] = member_[static_cast<std::size_t>(from)];
    weight_[static_cast<std::size_t>(to)] = weight_[static_cast<std::size_t>(from)];
    chosen_.col(to) = chosen_.col(from);
    right_side_[to] = right_side_[from];
    gram_.col(to).head(size_) = gram_.col(from).head(size_).eval();
    gram_.row(to).head(size_) = gram_.row(from).head(size_).eval();
  }

  const Eigen::MatrixXd& columns_;
  const Eigen::VectorXd& sum_;
  Eigen::Index most_;
  Eigen::Index size_ = 0;
  Eigen::MatrixXd chosen_;
  Eigen::MatrixXd gram_;
  Eigen::VectorXd right_side_;
  std::vector<std::uint8_t> used_;
  std::vector<Eigen::Index> member_;
  std::vector<double> weight_;
  Eigen::VectorXd residual_;
};

}  // namespace

SparseWeights find_sparse_weights(const Eigen::MatrixXd& columns, const Eigen::VectorXd& sum,
                                  double aim, int most_columns, const std::atomic<bool>* cancel) {
  if (columns.cols() == 0) {
    return {.column = {}, .weight = {}, .residual = sum.norm()};
  }
  ActiveSet set(columns, sum, most_columns);
  Eigen::VectorXd length = columns.colwise().norm();
  length = length.cwiseMax(1e-12 * std::max(length.maxCoeff(), 1e-300));
  std::vector<Eigen::Index> order(static_cast<std::size_t>(columns.cols()));
  std::iota(order.begin(), order.end(), 0);
  double before = std::numeric_limits<double>::infinity();
  int idle = 0;
  while (set.residual().norm() > aim && !set.full() && idle < kMostIdleRounds) {
    if (cancel != nullptr && *cancel) {
      break;
    }
    Eigen::VectorXd along = (columns.transpose() * set.residual()).cwiseQuotient(length);
    for (Eigen::Index k = 0; k < along.size(); ++k) {
      along[k] = set.uses(k) ? 0.0 : along[k];
    }
    const auto count = std::min<std::size_t>(kMostAtOnce, order.size());
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count),
                      order.end(),
                      [&along](Eigen::Index a, Eigen::Index b) { return along[a] > along[b]; });
    const double best = along[order.front()];
    if (!(best > 0.0)) {
      break;
    }
    for (std::size_t k = 0; k < count && !set.full(); ++k) {
      if (along[order[k]] >= kNearlyBest * best) {
        set.add(order[k]);
      }
    }
    set.settle();
    const double now = set.residual().norm();
    idle = now < before * (1.0 - 1e-6) ? 0 : idle + 1;
    before = std::min(before, now);
  }
  return set.result();
}

}  // namespace forcegrid::simulator
