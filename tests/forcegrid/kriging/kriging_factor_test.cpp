// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_factor.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <random>
#include <type_traits>
#include <vector>

namespace forcegrid::kriging {
namespace {

constexpr unsigned kSeed = 5;
constexpr int kMaxRows = 45;
using Factor = GrowingCholesky<kMaxRows>;

// A dense twin of the factor: the matrix and the data, solved from scratch by Eigen.
struct Dense {
  Eigen::MatrixXd k = Eigen::MatrixXd(0, 0);
  Eigen::VectorXd f = Eigen::VectorXd(0);

  Eigen::VectorXd weights() const { return k.llt().solve(f); }
};

// Some smooth covariance of two quantities with numbers s and t.
double covariance(double s, double t) { return std::exp(-0.5 * (s - t) * (s - t)) + s * t; }

// By linearity, the sum of the data carried along is the data of the sum.
TEST(GrowingCholeskyMore, CarriesOtherDataThroughAppendingAndRemoving) {
  using WithMore = GrowingCholesky<kMaxRows, 2>;
  constexpr double kNoise = 1e-3;
  const Eigen::Vector2d factors(0.5, -2.0);
  WithMore carried;
  Factor summed;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<double> at;
  const auto append = [&] {
    WithMore::Columns x;
    Factor::Columns y;
    Eigen::Matrix3d own;
    Eigen::Vector3d values;
    Eigen::Matrix<double, 3, 2> more;
    const Eigen::Vector3d fresh(uniform(random), uniform(random), uniform(random));
    for (int c = 0; c < 3; ++c) {
      for (std::size_t r = 0; r < at.size(); ++r) {
        const auto column = static_cast<std::size_t>(c);
        x.column[column][r] = y.column[column][r] = covariance(fresh[c], at[r]);
      }
      for (int b = 0; b < 3; ++b) {
        own(c, b) = covariance(fresh[c], fresh[b]) + (b == c ? kNoise : 0.0);
      }
      values[c] = uniform(random);
      more.row(c) << uniform(random), uniform(random);
    }
    carried.solve(x, 3);
    carried.append<3>(x, own, values, 0.1 * kNoise);
    carried.append_more<3>(x, more);
    summed.solve(y, 3);
    summed.append<3>(y, own, values + more * factors, 0.1 * kNoise);
    at.insert(at.end(), fresh.begin(), fresh.end());
  };
  for (int i = 0; i < 12; ++i) {
    append();
  }
  for (const int first : {3, 0, 24}) {
    carried.remove(first, 3);
    summed.remove(first, 3);
    at.erase(at.begin() + first, at.begin() + first + 3);
    append();
  }
  std::array<double, WithMore::kStride> sum{};
  carried.sum_of_data(factors, sum.data());
  ASSERT_EQ(carried.rows(), 36);
  for (int r = 0; r < 36; ++r) {
    EXPECT_NEAR(sum[static_cast<std::size_t>(r)], summed.y(r), 1e-9 * (1.0 + std::abs(summed.y(r))))
        << r;
  }
}

// The inner products of the data in the norm of K^-1, of rows appended by three and by six.
TEST(GrowingCholeskyMore, HasTheProductsOfItsData) {
  using WithMore = GrowingCholesky<kMaxRows, 2>;
  constexpr double kNoise = 1e-3;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  WithMore factor;
  std::vector<double> at;
  Eigen::MatrixXd data(0, 3);  // the two others, then the factor's own
  const auto append = [&](auto count) {
    constexpr int kCount = decltype(count)::value;
    const auto first = static_cast<Eigen::Index>(at.size());
    for (int c = 0; c < kCount; ++c) {
      at.push_back(uniform(random));
    }
    data.conservativeResize(first + kCount, 3);
    data.bottomRows(kCount) =
        Eigen::MatrixXd::NullaryExpr(kCount, 3, [&] { return uniform(random); });
    WithMore::Columns x;
    Eigen::Matrix<double, kCount, kCount> own;
    for (int c = 0; c < kCount; ++c) {
      const double s = at[static_cast<std::size_t>(first + c)];
      for (std::size_t r = 0; r < static_cast<std::size_t>(first); ++r) {
        x.column[static_cast<std::size_t>(c)][r] = covariance(s, at[r]);
      }
      for (int b = 0; b < kCount; ++b) {
        own(c, b) =
            covariance(s, at[static_cast<std::size_t>(first + b)]) + (b == c ? kNoise : 0.0);
      }
    }
    factor.solve(x, kCount);
    factor.append<kCount>(x, own, data.template bottomRightCorner<kCount, 1>(), 0.1 * kNoise);
    factor.append_more<kCount>(x, data.template bottomLeftCorner<kCount, 2>());
  };
  for (int i = 0; i < 4; ++i) {
    append(std::integral_constant<int, 3>());
    append(std::integral_constant<int, 6>());
  }
  Eigen::MatrixXd k(36, 36);
  for (int r = 0; r < 36; ++r) {
    for (int c = 0; c < 36; ++c) {
      k(r, c) = covariance(at[static_cast<std::size_t>(r)], at[static_cast<std::size_t>(c)]) +
                (r == c ? kNoise : 0.0);
    }
  }
  const Eigen::Matrix3d expected = data.transpose() * k.llt().solve(data);
  EXPECT_LT((factor.data_products() - expected).norm(), 1e-8 * expected.norm()) << "seed " << kSeed;
  factor.clear_more();
  EXPECT_TRUE((factor.data_products().topRows<2>().isZero()));
}

class GrowingCholeskyTest : public ::testing::Test {
 protected:
  template <int kCount>
  void append() {
    const int rows = static_cast<int>(at_.size());
    Factor::Columns x;
    Eigen::Matrix<double, kCount, kCount> own;
    Eigen::Matrix<double, kCount, 1> values;
    std::array<double, kCount> fresh;
    for (double& s : fresh) {
      s = uniform_(random_);
    }
    dense_.k.conservativeResize(rows + kCount, rows + kCount);
    dense_.f.conservativeResize(rows + kCount);
    for (int c = 0; c < kCount; ++c) {
      const double s = fresh[static_cast<std::size_t>(c)];
      for (int r = 0; r < rows; ++r) {
        x.column[static_cast<std::size_t>(c)][static_cast<std::size_t>(r)] = dense_.k(r, rows + c) =
            dense_.k(rows + c, r) = covariance(s, at_[static_cast<std::size_t>(r)]);
      }
      for (int b = 0; b < kCount; ++b) {
        own(c, b) = dense_.k(rows + c, rows + b) =
            covariance(s, fresh[static_cast<std::size_t>(b)]) + (b == c ? kNoise : 0.0);
      }
      values[c] = dense_.f[rows + c] = uniform_(random_);
    }
    at_.insert(at_.end(), fresh.begin(), fresh.end());
    factor_.solve(x, kCount);
    factor_.append<kCount>(x, own, values, 0.1 * kNoise);
  }
  void remove(int first, int count) {
    factor_.remove(first, count);
    at_.erase(at_.begin() + first, at_.begin() + first + count);
    const int rows = static_cast<int>(dense_.f.size());
    const int behind = rows - first - count;
    dense_.k.middleRows(first, behind) = dense_.k.bottomRows(behind).eval();
    dense_.k.middleCols(first, behind) = dense_.k.rightCols(behind).eval();
    dense_.f.segment(first, behind) = dense_.f.tail(behind).eval();
    dense_.k.conservativeResize(rows - count, rows - count);
    dense_.f.conservativeResize(rows - count);
  }
  void expect_equal() {
    ASSERT_EQ(factor_.rows(), dense_.f.size());
    std::array<double, Factor::kStride> alpha{};
    factor_.weights(alpha.data());
    const Eigen::Map<const Eigen::VectorXd> ours(alpha.data(), factor_.rows());
    const Eigen::VectorXd theirs = dense_.weights();
    EXPECT_LT((ours - theirs).norm(), 1e-9 * (1.0 + theirs.norm()));
  }

  static constexpr double kNoise = 1e-3;
  std::mt19937 random_{kSeed};
  std::uniform_real_distribution<double> uniform_{-2.0, 2.0};
  std::vector<double> at_;
  Factor factor_;
  Dense dense_;
};

TEST_F(GrowingCholeskyTest, SolvesLikeADenseFactorisationWhateverIsAppendedAndRemoved) {
  RecordProperty("seed", static_cast<int>(kSeed));
  for (int step = 0; step < 300; ++step) {
    const int rows = static_cast<int>(at_.size());
    const auto choice = random_() % 3;
    if (choice == 0 && rows + 6 <= kMaxRows) {
      append<6>();
    } else if (choice == 1 && rows + 3 <= kMaxRows) {
      append<3>();
    } else if (rows >= 6) {
      const int count = random_() % 2 == 0 ? 3 : 6;
      remove(static_cast<int>(random_() % static_cast<unsigned>(rows - count + 1)), count);
    }
    ASSERT_NO_FATAL_FAILURE(expect_equal()) << "after step " << step;
  }
}

TEST_F(GrowingCholeskyTest, ExplainsWhatADenseSolveExplains) {
  for (int i = 0; i < 5; ++i) {
    append<3>();
  }
  Factor::Columns x;
  Eigen::MatrixXd k(15, 3);
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 15; ++r) {
      x.column[static_cast<std::size_t>(c)][static_cast<std::size_t>(r)] = k(r, c) =
          covariance(0.4 * c, at_[static_cast<std::size_t>(r)]);
    }
  }
  factor_.solve(x, 3);
  const Eigen::Matrix3d explained = k.transpose() * dense_.k.llt().solve(k);
  EXPECT_TRUE(factor_.explained<3>(x).isApprox(explained, 1e-9));
  const Eigen::Vector3d mean = k.transpose() * dense_.weights();
  EXPECT_TRUE(factor_.mean<3>(x).isApprox(mean, 1e-9));
}

TEST_F(GrowingCholeskyTest, SurvivesARowThatRoundingLeavesNothingOf) {
  const Eigen::Matrix3d ones = Eigen::Matrix3d::Constant(1.0);
  factor_.append<3>(Factor::Columns{}, ones, Eigen::Vector3d::Ones(), 1e-6);
  std::array<double, Factor::kStride> alpha{};
  factor_.weights(alpha.data());
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_TRUE(std::isfinite(alpha[i]));
  }
}

// Every instruction set that this processor has, against the plain loops.
class Lanes : public ::testing::TestWithParam<int64_t> {
 public:
  ~Lanes() override { hwy::SetSupportedTargetsForTest(0); }

 protected:
  Lanes() { hwy::SetSupportedTargetsForTest(GetParam()); }
  double number() { return uniform_(random_); }

  std::mt19937 random_{kSeed};
  std::uniform_real_distribution<double> uniform_{-1.0, 1.0};
};

TEST_P(Lanes, SolveLikePlainLoops) {
  for (const int rows : {1, 3, 7, 16, 33}) {
    constexpr int kCapacity = 40;
    std::vector<double> packed(kCapacity * (kCapacity + 1) / 2 + kLanePadding);
    std::vector<double> inverse(kCapacity);
    PackedLower l{packed.data(), inverse.data(), kCapacity, rows};
    for (int j = 0; j < rows; ++j) {
      for (int r = j; r < rows; ++r) {
        l.column(j)[r] = r == j ? 2.0 + number() : 0.3 * number();
      }
      inverse[static_cast<std::size_t>(j)] = 1.0 / l.column(j)[j];
    }
    std::vector<double> x(3 * 60), y;
    for (double& v : x) {
      v = number();
    }
    y = x;
    double* const x3[3] = {x.data(), x.data() + 60, x.data() + 120};
    double* const y3[3] = {y.data(), y.data() + 60, y.data() + 120};
    solve_lower(l, x3);
    solve_lower_scalar(l, y3);
    std::vector<double> u(60, 1.0), v(60, 1.0);
    solve_upper(l, u.data());
    solve_upper_scalar(l, v.data());
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(x3[c][r], y3[c][r], 1e-12) << rows;
      }
      EXPECT_NEAR(u[static_cast<std::size_t>(r)], v[static_cast<std::size_t>(r)], 1e-12) << rows;
    }
  }
}

TEST_P(Lanes, RotateLikePlainLoopsAlsoIntoTheColumnsBelow) {
  const Rotations by = {{0.6, 0.28, -0.8}, {0.8, 0.96, 0.6}};
  for (const int count : {0, 1, 5, 8, 37}) {
    std::array<std::vector<double>, 2> column;
    std::array<std::array<std::vector<double>, 3>, 2> others;
    // Three columns of a PackedLower, each longer than the one behind it.
    const std::size_t above = 3 * static_cast<std::size_t>(count) + 6;
    column[0].resize(above + 64);
    std::generate(column[0].begin(), column[0].end(), [this] { return number(); });
    for (std::vector<double>& other : others[0]) {
      other.resize(64);
      std::generate(other.begin(), other.end(), [this] { return number(); });
    }
    column[1] = column[0];
    others[1] = others[0];
    for (const std::size_t way : {0U, 1U}) {
      double* const three[3] = {others[way][0].data(), others[way][1].data(),
                                others[way][2].data()};
      double* const at = column[way].data();
      (way == 0 ? rotate : rotate_scalar)(at + above, three, at, count, by);
    }
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      EXPECT_NEAR(column[0][i], column[1][i], 1e-15) << count;
      for (std::size_t c = 0; c < 3; ++c) {
        EXPECT_NEAR(others[0][c][i], others[1][c][i], 1e-15) << count;
      }
    }
  }
}

template <typename Real>
void expect_equal_sums(RadialShape shape, std::mt19937& random, Real tolerance) {
  std::uniform_real_distribution<Real> uniform(Real(-1), Real(1));
  alignas(64) std::array<std::array<Real, 32>, 6> samples;
  alignas(64) std::array<std::array<Real, 4>, 9> few;
  for (std::size_t a = 0; a < 6; ++a) {
    for (Real& v : samples[a]) {
      v = uniform(random);
    }
  }
  for (std::size_t a = 0; a < 9; ++a) {
    for (Real& v : few[a]) {
      v = uniform(random) * (a < 3 ? Real(0.03) : Real(0.01));
    }
  }
  RadialTerms<Real> terms;
  terms.sample_rows = samples[0].data();
  terms.stride = static_cast<int>(samples[0].size());
  terms.stiffness_rows = few[0].data();
  terms.stiffness_stride = static_cast<int>(few[0].size());
  terms.shape = shape;
  for (const int count : {16, 32}) {
    for (const int stiffness : {0, 4}) {
      terms.samples = count;
      terms.stiffness_samples = stiffness;
      for (int i = 0; i < 20; ++i) {
        const Real p[3] = {Real(0.03) * uniform(random), Real(0.03) * uniform(random),
                           Real(0.2) * uniform(random)};
        const RadialSum<Real> lanes = radial_sum(terms, p);
        const RadialSum<Real> plain = radial_sum_scalar(terms, p);
        for (int a = 0; a < 3; ++a) {
          EXPECT_NEAR(lanes.force_N[a], plain.force_N[a], tolerance);
        }
        EXPECT_NEAR(lanes.nearest_m2, plain.nearest_m2, Real(1e-6) * plain.nearest_m2);
        const RadialSlope<Real> slope = radial_slope(terms, p);
        const RadialSlope<Real> plain_slope = radial_slope_scalar(terms, p);
        for (int k = 0; k < 6; ++k) {  // a length is some 30 times less than a metre
          EXPECT_NEAR(slope.stiffness_N_per_m[k], plain_slope.stiffness_N_per_m[k],
                      Real(100) * tolerance);
        }
      }
    }
  }
}

TEST_P(Lanes, SumLikePlainLoops) {
  for (const RadialShape shape : {RadialShape::kSquaredExponential, RadialShape::kMatern72}) {
    expect_equal_sums<float>(shape, random_, 3e-5F);  // 32 terms of size one in single precision
    expect_equal_sums<double>(shape, random_, 1e-13);
  }
}

// Samples within a millimetre, with weights of up to a kilonewton: what is left without the
// weights' sum is a hundred times smaller, and so must its rounding be.
TEST_P(Lanes, SumLargeWeightsOfSamplesNearEachOther) {
  constexpr double kLength_m = 0.03;
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  alignas(64) std::array<std::array<double, 32>, 6> samples;
  alignas(64) std::array<std::array<float, 32>, 6> single_samples;
  for (std::size_t a = 0; a < 6; ++a) {
    for (std::size_t i = 0; i < 32; ++i) {
      samples[a][i] = uniform(random_) * (a < 3 ? 0.001 / kLength_m : 1000.0);
      single_samples[a][i] = static_cast<float>(samples[a][i]);
      samples[a][i] = static_cast<double>(single_samples[a][i]);
    }
  }
  RadialTerms<double> terms;
  terms.sample_rows = samples[0].data();
  terms.stride = terms.samples = 32;
  RadialTerms<float> single_terms;
  single_terms.sample_rows = single_samples[0].data();
  single_terms.stride = single_terms.samples = 32;
  for (int i = 0; i < 20; ++i) {
    const float single_p[3] = {static_cast<float>(0.001 * uniform(random_)),
                               static_cast<float>(0.001 * uniform(random_)),
                               static_cast<float>(0.001 * uniform(random_))};
    const double p[3] = {single_p[0], single_p[1], single_p[2]};
    const RadialSum<double> sum = radial_sum(terms, p);
    const RadialSum<float> single_sum = radial_sum(single_terms, single_p);
    for (int a = 0; a < 3; ++a) {
      EXPECT_NEAR(single_sum.force_N[a], sum.force_N[a], 1e-5);
    }
  }
}

std::vector<int64_t> targets() {
  std::vector<int64_t> each;
  for (int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1) {
    each.push_back(left & -left);
  }
  return each;
}

INSTANTIATE_TEST_SUITE_P(Targets, Lanes, ::testing::ValuesIn(targets()), [](const auto& parameter) {
  return std::string(hwy::TargetName(parameter.param));
});

}  // namespace
}  // namespace forcegrid::kriging
