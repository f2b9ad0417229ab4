// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_field.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <memory>
#include <vector>

#include "tests/forcegrid/pair/series_springs.h"

namespace forcegrid::pair {
namespace {

using testing::HardeningPair;
using testing::RandomPositions;
using testing::SeriesSprings;

constexpr unsigned kSeed = 11;
constexpr double kReach_m = 0.012;

std::unique_ptr<PairField> field(double nugget_N2 = 1e-6, int samples = 32) {
  PairFieldSettings settings;
  settings.nugget_N2 = nugget_N2;
  settings.samples = samples;
  return std::make_unique<PairField>(settings);
}

std::unique_ptr<PairField> field_with_stiffness(int stiffness_samples, int samples = 32) {
  PairFieldSettings settings;
  settings.samples = samples;
  settings.stiffness_samples = stiffness_samples;
  return std::make_unique<PairField>(settings);
}

void take(PairField& field, const PairVector& p_m, const PairVector& f_N,
          const Matrix6* j_N_per_m = nullptr) {
  field.begin(p_m, f_N, j_N_per_m);
  while (field.prepare()) {
  }
}

// Only the left tool moves, so the right one's own stiffness stays unknown. But how the left
// tool's force depends on the right one's place follows from what the right one felt, since one
// energy has dF_1/dP_2 = (dF_2/dP_1)^T.
TEST(PairField, LearnsOneToolsForceFromWhatTheOtherFelt) {
  const SeriesSprings object;
  const auto learnt = field();
  RandomPositions positions(kSeed, kReach_m);
  for (int i = 0; i < 12; ++i) {
    PairVector p = positions.next();
    p.tail<3>().setZero();
    take(*learnt, p, object.forces_N(p));
  }
  PairVector right = PairVector::Zero();
  right.tail<3>() << 0.002, -0.001, 0.0015;
  const Eigen::Vector3d expected_N = object.forces_N(right).head<3>();  // c P_2, never sampled
  const Eigen::Vector3d found_N = learnt->read(right).forces_N.head<3>();
  EXPECT_LT((found_N - expected_N).norm(), 0.05 * expected_N.norm());
  const Matrix6 stiffness = learnt->stiffness_N_per_m(PairVector::Zero());
  EXPECT_LT(
      (stiffness.topRightCorner<3, 3>() - object.c_N_per_m * Eigen::Matrix3d::Identity()).norm(),
      0.02 * object.c_N_per_m);
}

TEST(PairField, IsExactOnSpringsInSeriesWithinTheNugget) {
  const SeriesSprings object;
  const auto learnt = field();
  RandomPositions positions(kSeed, kReach_m);
  for (int i = 0; i < 30; ++i) {
    const PairVector p = positions.next();
    take(*learnt, p, object.forces_N(p));
  }
  for (int i = 0; i < 30; ++i) {
    const PairVector p = positions.next();
    EXPECT_LT((learnt->read(p).forces_N - object.forces_N(p)).norm(), 0.01) << i;  // of some 3 N
  }
}

// alpha = (K + nugget I)^-1 F by a dense factorisation over the same samples.
TEST(PairField, IsDenseKrigingWhileTheDictionaryHoldsAll) {
  const HardeningPair object;
  const auto grown = field();
  const PairKernel& kernel = grown->settings().kernel;
  RandomPositions positions(kSeed, kReach_m);
  std::vector<PairVector> at;
  constexpr int kSamples = 20;
  Eigen::VectorXd data(6 * kSamples);
  for (int i = 0; i < kSamples; ++i) {
    at.push_back(positions.next());
    data.segment<6>(6 * i) = object.forces_N(at.back());
    take(*grown, at.back(), object.forces_N(at.back()));
    EXPECT_FALSE(grown->innovation().surprised);
  }
  ASSERT_EQ(grown->sample_count(), kSamples);
  Eigen::MatrixXd k(6 * kSamples, 6 * kSamples);
  for (int i = 0; i < kSamples; ++i) {
    for (int j = 0; j < kSamples; ++j) {
      k.block<6, 6>(6 * i, 6 * j) =
          kernel.force_force(at[static_cast<std::size_t>(i)], at[static_cast<std::size_t>(j)]);
    }
  }
  k.diagonal().array() += grown->settings().nugget_N2;
  const Eigen::VectorXd alpha = k.llt().solve(data);
  for (int trial = 0; trial < 20; ++trial) {
    const PairVector p = positions.next();
    PairVector expected_N = PairVector::Zero();
    for (int i = 0; i < kSamples; ++i) {
      expected_N +=
          kernel.force_force(p, at[static_cast<std::size_t>(i)]) * alpha.segment<6>(6 * i);
    }
    // Single precision of weights of some 100 N.
    EXPECT_LT((grown->read(p).forces_N - expected_N).norm(), 2e-3);
  }
}

TEST(PairField, KnowsAQuadraticEnergyAfterOneSampleWithItsStiffness) {
  const SeriesSprings object;
  RandomPositions positions(kSeed, kReach_m);
  const PairVector at_m = positions.next();
  const Matrix6 stiffness = object.stiffness_N_per_m();
  const auto without = field();
  const auto with = field_with_stiffness(1);
  take(*without, at_m, object.forces_N(at_m));
  take(*with, at_m, object.forces_N(at_m), &stiffness);
  double without_N2 = 0.0;
  for (int i = 0; i < 30; ++i) {
    const PairVector p = at_m + 0.5 * positions.next();
    // 1 N/m of noise over some 10 mm.
    EXPECT_LT((with->read(p).forces_N - object.forces_N(p)).norm(), 0.02) << i;
    without_N2 += (without->read(p).forces_N - object.forces_N(p)).squaredNorm();
  }
  EXPECT_GT(std::sqrt(without_N2 / 30.0), 0.5);
  EXPECT_LT((with->stiffness_N_per_m(at_m) - stiffness).norm(), 0.02 * stiffness.norm());
}

// As IsDenseKrigingWhileTheDictionaryHoldsAll, with 21 more rows for each of the newest samples.
TEST(PairField, IsDenseKrigingOfForcesAndOfTheNewestStiffnesses) {
  const HardeningPair object;
  constexpr int kSamples = 12;
  constexpr int kNewest = 3;
  const auto grown = field_with_stiffness(kNewest);
  const PairFieldSettings& settings = grown->settings();
  const PairKernel& kernel = settings.kernel;
  RandomPositions positions(kSeed, kReach_m);
  std::vector<PairVector> at;
  std::vector<Matrix6> slopes;
  for (int i = 0; i < kSamples; ++i) {
    at.push_back(positions.next());
    slopes.push_back(object.stiffness_N_per_m(at.back()));
    take(*grown, at.back(), object.forces_N(at.back()), &slopes.back());
    ASSERT_FALSE(grown->innovation().surprised);
  }
  ASSERT_EQ(grown->row_count(), 6 * kSamples + kStiffnessNumbers * kNewest);

  // Each row: a force's component, c < 0, or an entry (a, c) of a stiffness.
  struct Row {
    std::size_t sample;
    int a;
    int c;
    int number;  // of the stiffness
  };
  std::vector<Row> rows;
  for (std::size_t i = 0; i < kSamples; ++i) {
    for (int a = 0; a < 6; ++a) {
      rows.push_back({i, a, -1, -1});
    }
  }
  for (std::size_t i = kSamples - kNewest; i < kSamples; ++i) {
    for (int n = 0; n < kStiffnessNumbers; ++n) {
      rows.push_back({i, kStiffnessRow[n], kStiffnessColumn[n], n});
    }
  }
  const auto covariance = [&](const PairVector& p, const Row& one, const PairVector& q,
                              const Row& other) {
    const auto in_part = [](int number) { return number - part_begin(number / 6); };
    if (one.c < 0 && other.c < 0) {
      return kernel.force_force(p, q)(one.a, other.a);
    }
    if (one.c < 0) {
      return kernel.force_stiffness(p, q, other.number / 6)(one.a, in_part(other.number));
    }
    if (other.c < 0) {
      return kernel.force_stiffness(q, p, one.number / 6)(other.a, in_part(one.number));
    }
    return kernel.stiffness_stiffness(p, one.number / 6, q, other.number / 6)(
        in_part(one.number), in_part(other.number));
  };
  const auto count = static_cast<Eigen::Index>(rows.size());
  Eigen::MatrixXd k(count, count);
  Eigen::VectorXd data(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Row& one = rows[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j < count; ++j) {
      const Row& other = rows[static_cast<std::size_t>(j)];
      k(i, j) = covariance(at[one.sample], one, at[other.sample], other);
    }
    const Matrix6& slope = slopes[one.sample];
    const double relative = settings.relative_stiffness_noise * slope.norm();
    const double noise = settings.stiffness_noise_N_per_m;
    k(i, i) += one.c < 0 ? settings.nugget_N2 : noise * noise + relative * relative;
    data[i] = one.c < 0 ? object.forces_N(at[one.sample])[one.a] : slope(one.a, one.c);
  }
  const Eigen::VectorXd alpha = k.llt().solve(data);
  for (int trial = 0; trial < 20; ++trial) {
    const PairVector p = positions.next();
    PairVector expected_N = PairVector::Zero();
    for (int a = 0; a < 6; ++a) {
      for (Eigen::Index j = 0; j < count; ++j) {
        const Row& other = rows[static_cast<std::size_t>(j)];
        expected_N[a] += covariance(p, {0, a, -1, -1}, at[other.sample], other) * alpha[j];
      }
    }
    EXPECT_LT((grown->read(p).forces_N - expected_N).norm(), 2e-3);
  }
}

// A dictionary that is full and stiffnesses that come and go, against one made from the same
// samples at once: the surprise that cannot come makes the factor anew.
TEST(PairField, ForgetsTheStiffnessOfOlderSamplesExactly) {
  const HardeningPair object;
  constexpr int kSamples = 8;
  const auto grown = field_with_stiffness(2, kSamples);
  const auto fresh = field_with_stiffness(2, kSamples);
  PairVector p = PairVector::Zero();
  const auto next = [&](PairField& each, int i) {
    p.setConstant(1e-3 * i);  // in a line, so that the oldest is the farthest
    p[1] = 1e-3 * (i % 3);
    const Matrix6 slope = object.stiffness_N_per_m(p);
    take(each, p, object.forces_N(p), &slope);
  };
  for (int i = 0; i < 30; ++i) {
    next(*grown, i);
  }
  EXPECT_EQ(grown->row_count(), 6 * kSamples + 2 * kStiffnessNumbers);
  for (int i = 30 - kSamples; i < 30; ++i) {
    next(*fresh, i);
  }
  ASSERT_EQ(fresh->sample_count(), kSamples);
  const PairVector ahead = p + PairVector::Constant(1e-3);
  EXPECT_LT((grown->read(ahead).forces_N - fresh->read(ahead).forces_N).norm(),
            1e-3 * fresh->read(ahead).forces_N.norm());
}

TEST(PairField, AveragesAStiffnessWithItsTranspose) {
  const SeriesSprings object;
  Matrix6 skew = object.stiffness_N_per_m();
  skew(0, 4) += 40.0;
  skew(4, 0) -= 40.0;
  const auto plain = field_with_stiffness(1);
  const auto skewed = field_with_stiffness(1);
  const PairVector at_m = PairVector::Constant(1e-3);
  const Matrix6 straight = object.stiffness_N_per_m();
  take(*plain, at_m, object.forces_N(at_m), &straight);
  take(*skewed, at_m, object.forces_N(at_m), &skew);
  EXPECT_EQ(skewed->read(PairVector::Zero()).forces_N, plain->read(PairVector::Zero()).forces_N);
}

TEST(PairField, HasASymmetricStiffnessThatIsTheSlopeOfItsForce) {
  const HardeningPair object;
  const auto learnt = field_with_stiffness(3);
  RandomPositions positions(kSeed, kReach_m);
  for (int i = 0; i < 40; ++i) {
    const PairVector p = positions.next();
    const Matrix6 slope = object.stiffness_N_per_m(p);
    take(*learnt, p, object.forces_N(p), &slope);
  }
  constexpr double kStep_m = 1e-3;  // single precision of the force, 1e-6 N, leaves 1e-3 N/m
  const PairVector p = 0.3 * positions.next();
  const Matrix6 exact = learnt->stiffness_N_per_m(p);
  EXPECT_LT((exact - exact.transpose()).norm(), 1e-3 * exact.norm());
  for (int c = 0; c < 6; ++c) {
    const PairVector step = kStep_m * PairVector::Unit(c);
    const PairVector slope =
        (learnt->read(p + step).forces_N - learnt->read(p - step).forces_N) / (2.0 * kStep_m);
    EXPECT_LT((exact.col(c) - slope).norm(), 0.01 * exact.norm()) << c;
  }
}

TEST(PairField, KeepsItsAnswerUntilTheLastPieceOfASample) {
  const HardeningPair object;
  const auto learnt = field();
  RandomPositions positions(kSeed, kReach_m);
  for (int i = 0; i < 50; ++i) {  // with a full dictionary, rows are removed as well
    const PairVector p = positions.next();
    take(*learnt, p, object.forces_N(p));
  }
  const PairVector p = positions.next();
  const PairVector before_N = learnt->read(p).forces_N;
  const Matrix6 slope_before = learnt->stiffness_N_per_m(p);
  learnt->begin(p, object.forces_N(p));
  int pieces = 0;
  while (!learnt->ready()) {
    EXPECT_EQ(learnt->read(p).forces_N, before_N);
    EXPECT_EQ(learnt->stiffness_N_per_m(p), slope_before);
    EXPECT_TRUE(learnt->prepare());
    ++pieces;
  }
  EXPECT_LE(pieces, 3);
  EXPECT_FALSE(learnt->prepare());
  EXPECT_NE(learnt->read(p).forces_N, before_N);
  EXPECT_LT((learnt->read(p).forces_N - object.forces_N(p)).norm(), 0.01);
}

TEST(PairField, PutsOffItsWeightsAsLongAsNobodyReads) {
  const HardeningPair object;
  const auto read_always = field();
  const auto read_late = field();
  read_late->expect_reads(false);
  RandomPositions positions(kSeed, kReach_m);
  for (int i = 0; i < 20; ++i) {
    const PairVector p = positions.next();
    take(*read_always, p, object.forces_N(p));
    take(*read_late, p, object.forces_N(p));
    EXPECT_EQ(read_late->innovation().error_N, read_always->innovation().error_N);
  }
  EXPECT_FALSE(read_late->readable());
  read_late->expect_reads(true);
  EXPECT_TRUE(read_late->prepare());
  EXPECT_FALSE(read_late->prepare());
  const PairVector p = positions.next();
  EXPECT_EQ(read_late->read(p).forces_N, read_always->read(p).forces_N);
}

TEST(PairField, NeverKeepsMoreThanItsDictionaryAndKnowsTheNewest) {
  const HardeningPair object;
  RandomPositions positions(kSeed, kReach_m);
  for (const int capacity : {2, 16, 48}) {
    const auto learnt = field(1e-6, capacity);
    for (int i = 0; i < 120; ++i) {
      const PairVector p = positions.next();
      take(*learnt, p, object.forces_N(p));
      ASSERT_LE(learnt->sample_count(), capacity);
      ASSERT_EQ(learnt->row_count(), 6 * learnt->sample_count());
      EXPECT_LT((learnt->read(p).forces_N - object.forces_N(p)).norm(), 0.02) << i;
    }
    EXPECT_EQ(learnt->sample_count(), capacity);
  }
}

// Hands at rest repeat one sample; the dictionary keeps the place once.
TEST(PairField, ReplacesASampleOfTheSamePlace) {
  const SeriesSprings object;
  const auto learnt = field();
  PairVector p = PairVector::Zero();
  for (int i = 0; i < 20; ++i) {
    p[0] = 1e-5 * i;
    take(*learnt, p, object.forces_N(p));
  }
  EXPECT_LE(learnt->sample_count(), 2);
}

// The object becomes half as stiff. Afterwards the field comes close to one that has only ever
// seen the object as it is; one that never doubts is not.
TEST(PairField, ForgetsWhatASurpriseContradicts) {
  const HardeningPair object;
  PairFieldSettings trusting_settings;
  trusting_settings.surprise = 1e12;
  const auto learnt = field();
  const auto trusting = std::make_unique<PairField>(trusting_settings);
  const auto fresh = field();
  RandomPositions positions(kSeed, kReach_m);
  for (int i = 0; i < 40; ++i) {
    const PairVector p = positions.next();
    take(*learnt, p, object.forces_N(p));
    take(*trusting, p, object.forces_N(p));
  }
  int surprises = 0;
  double learnt_N = 0.0;
  double trusting_N = 0.0;
  double fresh_N = 0.0;
  for (int i = 0; i < 40; ++i) {
    const PairVector p = positions.next();
    const PairVector f = 0.5 * object.forces_N(p);
    for (PairField* each : {learnt.get(), trusting.get(), fresh.get()}) {
      take(*each, p, f);
    }
    surprises += learnt->innovation().surprised ? 1 : 0;
    if (i >= 20) {  // the dictionary still has room for samples of before
      learnt_N += learnt->innovation().error_N;
      trusting_N += trusting->innovation().error_N;
      fresh_N += fresh->innovation().error_N;
    }
  }
  EXPECT_GT(surprises, 0);
  EXPECT_LT(learnt_N, 4.0 * fresh_N);
  EXPECT_GT(trusting_N, 2.0 * learnt_N);
}

TEST(PairField, ForgetsEverythingWhenCleared) {
  const SeriesSprings object;
  const auto learnt = field();
  take(*learnt, PairVector::Constant(0.001), object.forces_N(PairVector::Constant(0.001)));
  EXPECT_TRUE(learnt->readable());
  learnt->begin(PairVector::Zero(), PairVector::Zero());
  learnt->clear();
  EXPECT_TRUE(learnt->ready());
  EXPECT_FALSE(learnt->readable());
  EXPECT_EQ(learnt->sample_count(), 0);
  EXPECT_EQ(learnt->row_count(), 0);
}

}  // namespace
}  // namespace forcegrid::pair
