// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "forcegrid/kriging/kriging_simd.h"

namespace forcegrid::kriging {

/// Cholesky factor L of a covariance matrix K = L L^T that grows and shrinks by a few rows, with
/// the data carried along as y = L^-1 f, so that K^-1 f costs one back substitution. So are kMore
/// other data r_j of the same rows, y_j = L^-1 r_j.
///
/// Appending k rows to n costs k n^2/2 multiplications; removing a row costs those of the rows
/// behind it (rank-one update by Givens rotations, stable since it only adds). Double precision:
/// the samples' noise is down to 1e-6 of their variance.
/// Source: Golub and Van Loan, Matrix Computations, 4th ed. (2013), section 6.5.
/// Real-time: no allocation, lock or throw. Threads: one.
template <int kMaxRows, int kMore = 0>
class GrowingCholesky {
 public:
  /// Right-hand sides: columns of kMaxRows numbers with room for the lanes behind them.
  static constexpr int kStride = padded(kMaxRows, 4) + kLanePadding;
  struct Columns {
    alignas(64) std::array<std::array<double, kStride>, 6> column{};
  };

  int rows() const noexcept { return rows_; }
  double y(int row) const noexcept { return y_[static_cast<std::size_t>(row)]; }
  /// y, in its first rows() numbers.
  const std::array<double, kStride>& y() const noexcept { return y_; }
  /// |y|^2: the squares of the data relative to the prior's expectation.
  double squares() const noexcept {
    double sum = 0.0;
    for (int row = 0; row < rows_; ++row) {
      sum += y(row) * y(row);
    }
    return sum;
  }
  void clear() noexcept { rows_ = 0; }

  /// x <- L^-1 x of the first `count` columns, 3 or 6.
  void solve(Columns& x, int count) const noexcept {
    for (int first = 0; first < count; first += 3) {
      double* const three[3] = {x.column[static_cast<std::size_t>(first)].data(),
                                x.column[static_cast<std::size_t>(first) + 1].data(),
                                x.column[static_cast<std::size_t>(first) + 2].data()};
      solve_lower(lower(), three);
    }
  }

  /// x <- L^-1 x of three columns that are zero above row `first`; each has kStride numbers.
  void solve_from(int first, double* const x[3]) const noexcept {
    double* const below[3] = {x[0] + first, x[1] + first, x[2] + first};
    solve_lower(lower_from(first), below);
  }

  /// Data f <- f + factor * (L x), given x as solved: y <- y + factor x.
  void add_to_data(const std::array<double, kStride>& x, double factor) noexcept {
    for (std::size_t r = 0; r < static_cast<std::size_t>(rows_); ++r) {
      y_[r] += factor * x[r];
    }
  }

  /// K^-1 f.
  void weights(double* alpha) const noexcept {
    std::copy_n(y_.data(), rows_, alpha);
    solve_upper(lower(), alpha);
  }

  /// y + sum_j factors_j y_j: the data of the sum.
  void sum_of_data(const Eigen::Matrix<double, kMore, 1>& factors, double* sum) const noexcept {
    std::copy_n(y_.data(), rows_, sum);
    for (std::size_t j = 0; j < more_.size(); ++j) {
      for (std::size_t r = 0; r < static_cast<std::size_t>(rows_); ++r) {
        sum[r] += factors[static_cast<int>(j)] * more_[j][r];
      }
    }
  }

  /// alpha <- L^-T alpha; it has room for kLanePadding numbers behind its rows.
  void solve_transposed(double* alpha) const noexcept { solve_upper(lower(), alpha); }

  /// Its rows from `first` on; those above stay as they are.
  void solve_transposed_from(int first, double* alpha) const noexcept {
    solve_upper(lower_from(first), alpha + first);
  }

  /// Mean of `kCount` new quantities whose covariances with the rows are solved in `x`: x^T y.
  template <int kCount>
  Eigen::Matrix<double, kCount, 1> mean(const Columns& x) const noexcept {
    Eigen::Matrix<double, kCount, 1> sum = Eigen::Matrix<double, kCount, 1>::Zero();
    for (std::size_t r = 0; r < static_cast<std::size_t>(rows_); ++r) {
      for (int c = 0; c < kCount; ++c) {
        sum[c] += x.column[static_cast<std::size_t>(c)][r] * y_[r];
      }
    }
    return sum;
  }

  /// Their means by the other data: column j is x^T y_j.
  template <int kCount = 3>
  Eigen::Matrix<double, kCount, kMore> more_means(const Columns& x) const noexcept {
    Eigen::Matrix<double, kCount, kMore> sums = Eigen::Matrix<double, kCount, kMore>::Zero();
    for (std::size_t j = 0; j < more_.size(); ++j) {
      for (std::size_t r = 0; r < static_cast<std::size_t>(rows_); ++r) {
        for (std::size_t c = 0; c < kCount; ++c) {
          sums(static_cast<int>(c), static_cast<int>(j)) += x.column[c][r] * more_[j][r];
        }
      }
    }
    return sums;
  }

  /// The inner products of y_0, y_1, ... and, last, y.
  Eigen::Matrix<double, kMore + 1, kMore + 1> data_products() const noexcept {
    using Products = Eigen::Matrix<double, kMore + 1, kMore + 1>;
    Products sums = Products::Zero();
    Eigen::Matrix<double, kMore + 1, 1> row;
    for (std::size_t r = 0; r < static_cast<std::size_t>(rows_); ++r) {
      for (std::size_t j = 0; j < more_.size(); ++j) {
        row[static_cast<int>(j)] = more_[j][r];
      }
      row[kMore] = y_[r];
      sums.noalias() += row * row.transpose();
    }
    return sums;
  }

  /// The part of their covariance that the rows explain: x^T x.
  template <int kCount>
  Eigen::Matrix<double, kCount, kCount> explained(const Columns& x) const noexcept {
    Eigen::Matrix<double, kCount, kCount> sum = Eigen::Matrix<double, kCount, kCount>::Zero();
    Eigen::Matrix<double, kCount, 1> row;
    for (std::size_t r = 0; r < static_cast<std::size_t>(rows_); ++r) {
      for (int c = 0; c < kCount; ++c) {
        row[c] = x.column[static_cast<std::size_t>(c)][r];
      }
      for (int c = 0; c < kCount; ++c) {
        for (int b = c; b < kCount; ++b) {
          sum(b, c) += row[b] * row[c];
        }
      }
    }
    return sum.template selfadjointView<Eigen::Lower>();
  }

  /// Appends rows: `x` their covariances with the rows before, solved; `own` their own covariance,
  /// noise included; `values` their data. Where rounding would leave less than `floor_variance` of
  /// a row unexplained, that much is assumed; this can only happen to a repeated sample.
  template <int kCount>
  void append(const Columns& x, const Eigen::Matrix<double, kCount, kCount>& own,
              const Eigen::Matrix<double, kCount, 1>& values, double floor_variance) noexcept {
    Eigen::Matrix<double, kCount, kCount> rest = own - explained<kCount>(x);
    Eigen::Matrix<double, kCount, 1> y = values - mean<kCount>(x);
    const PackedLower l = lower();
    for (int j = 0; j < rows_; ++j) {
      double* column = l.column(j) + rows_;
      for (int c = 0; c < kCount; ++c) {
        column[c] = x.column[static_cast<std::size_t>(c)][static_cast<std::size_t>(j)];
      }
    }
    for (int c = 0; c < kCount; ++c) {
      const double diagonal = std::sqrt(std::max(rest(c, c), floor_variance));
      double* column = l.column(rows_ + c) + rows_;
      column[c] = diagonal;
      for (int b = c + 1; b < kCount; ++b) {
        column[b] = rest(b, c) / diagonal;
        for (int a = c + 1; a <= b; ++a) {
          rest(b, a) -= column[a] * column[b];
        }
      }
      y[c] /= diagonal;
      for (int b = c + 1; b < kCount; ++b) {
        y[b] -= column[b] * y[c];
      }
      inverse_diagonal_[static_cast<std::size_t>(rows_ + c)] = 1.0 / diagonal;
      y_[static_cast<std::size_t>(rows_ + c)] = y[c];
    }
    rows_ += kCount;
  }

  /// The other data of the last `kCount` rows, appended just before with the same `x`.
  template <int kCount>
  void append_more(const Columns& x, const Eigen::Matrix<double, kCount, kMore>& values) noexcept {
    const int first = rows_ - kCount;
    rows_ = first;
    Eigen::Matrix<double, kCount, kMore> y = values - more_means<kCount>(x);
    rows_ = first + kCount;
    const PackedLower l = lower();
    for (int c = 0; c < kCount; ++c) {
      const double* column = l.column(first + c) + first;
      for (int j = 0; j < kMore; ++j) {
        y(c, j) /= column[c];
        for (int b = c + 1; b < kCount; ++b) {
          y(b, j) -= column[b] * y(c, j);
        }
        more_[static_cast<std::size_t>(j)][static_cast<std::size_t>(first + c)] = y(c, j);
      }
    }
  }
  /// The other data of all rows become zero.
  void clear_more() noexcept {
    for (auto& y : more_) {
      y.fill(0.0);
    }
  }

  /// Removes `count` rows, a multiple of three, from `first` on. The last rows go without any work.
  void remove(int first, int count) noexcept {
    const int behind = rows_ - first - count;
    if (behind == 0) {
      rows_ = first;
      return;
    }
    const PackedLower l = lower();
    for (int j = 0; j < first; ++j) {
      double* at = l.column(j) + first;
      std::memmove(at, at + count, static_cast<std::size_t>(behind) * sizeof(double));
    }
    for (int end = first + count; end > first; end -= 3) {
      remove_three(end - 3, first);
    }
  }

 private:
  PackedLower lower() const noexcept {
    return {const_cast<double*>(data_.data()), inverse_diagonal_.data(), kMaxRows, rows_};
  }
  PackedLower lower_from(int first) const noexcept {
    return {lower().column(first) + first, inverse_diagonal_.data() + first, kMaxRows - first,
            rows_ - first};
  }

  // Removes the rows from `row` on. In the columns before `from` the rows behind have been moved
  // already.
  void remove_three(int row, int from) noexcept {
    const PackedLower l = lower();
    const int behind = rows_ - row - 3;
    for (int j = from; j < row; ++j) {
      double* at = l.column(j) + row;
      std::memmove(at, at + 3, static_cast<std::size_t>(behind) * sizeof(double));
    }
    // L' L'^T = L L^T + sum_i v_i v_i^T for the rows behind, where v_i are the removed rows'
    // columns, the last one's first.
    std::array<double, 3> removed_y;
    std::array<std::array<double, 3>, kMore> removed_more;
    for (int i = 0; i < 3; ++i) {
      const auto at = static_cast<std::size_t>(2 - i);
      const auto removed_row = static_cast<std::size_t>(row + i);
      std::copy_n(l.column(row + i) + row + 3, behind, removed_[at].data());
      removed_y[at] = y_[removed_row];
      for (std::size_t j = 0; j < more_.size(); ++j) {
        removed_more[j][at] = more_[j][removed_row];
      }
    }
    for (int k = 0; k < behind; ++k) {
      const int old = row + 3 + k;
      const auto old_row = static_cast<std::size_t>(old);
      const double* column = l.column(old) + old;
      double* moved = l.column(old - 3) + old - 3;
      Rotations by;
      double diagonal = column[0];
      for (std::size_t i = 0; i < 3; ++i) {
        const double v = removed_[i][static_cast<std::size_t>(k)];
        const double longer = std::sqrt(diagonal * diagonal + v * v);
        by.c[i] = diagonal / longer;
        by.s[i] = v / longer;
        diagonal = longer;
      }
      double* const others[3] = {removed_[0].data() + k + 1, removed_[1].data() + k + 1,
                                 removed_[2].data() + k + 1};
      rotate(column + 1, others, moved + 1, behind - k - 1, by);
      moved[0] = diagonal;
      inverse_diagonal_[old_row - 3] = 1.0 / diagonal;
      y_[old_row - 3] = rotated(y_[old_row], removed_y, by);
      for (std::size_t j = 0; j < more_.size(); ++j) {
        more_[j][old_row - 3] = rotated(more_[j][old_row], removed_more[j], by);
      }
    }
    rows_ -= 3;
  }

  // rotate() of single numbers. @returns the first one.
  static double rotated(double first, std::array<double, 3>& others, const Rotations& by) noexcept {
    for (std::size_t i = 0; i < 3; ++i) {
      const double before = first;
      first = by.c[i] * before + by.s[i] * others[i];
      others[i] = by.c[i] * others[i] - by.s[i] * before;
    }
    return first;
  }

  alignas(64) std::array<double, kMaxRows*(kMaxRows + 1) / 2 + kLanePadding> data_{};
  std::array<double, kStride> inverse_diagonal_{};
  std::array<double, kStride> y_{};
  std::array<std::array<double, kStride>, kMore> more_{};
  std::array<std::array<double, kStride>, 3> removed_{};
  int rows_ = 0;
};

}  // namespace forcegrid::kriging
