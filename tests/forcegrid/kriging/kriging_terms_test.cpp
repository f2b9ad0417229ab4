// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_terms.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using forcegrid::testing::AnchoredSprings;
using forcegrid::testing::HandMotion;

constexpr unsigned kSeed = 11;
constexpr double kPeriod_s = 1.0 / 30.0;
constexpr int kSamples = 150;

// The relative error at the last second's samples, predicted one period ahead.
struct Score {
  double squares_N2 = 0.0;
  double reference_N2 = 0.0;
  void add(int sample, const Vector3d& error_N, const Vector3d& reference_N) {
    if (sample >= kSamples - 30) {
      squares_N2 += error_N.squaredNorm();
      reference_N2 += reference_N.squaredNorm();
    }
  }
  double relative() const { return std::sqrt(squares_N2 / reference_N2); }
};

// F_k = F_{k-1} + share (F(p_k) - F_{k-1}): what the field should say is F(p_k).
double lag_error(LagField& field, double share) {
  const AnchoredSprings object(kSeed);
  const HandMotion hand(kSeed);
  Score score;
  Vector3d answer_N = Vector3d::Zero();
  for (int k = 0; k < kSamples; ++k) {
    Observation o;
    o.position_m = hand.position_m(k * kPeriod_s);
    const Vector3d reference_N = object.force_N(o.position_m);
    score.add(k, field.read(o.position_m, o.history).force_N - reference_N, reference_N);
    o.rise_N = share * (reference_N - answer_N);
    answer_N += o.rise_N;
    o.force_N = answer_N;
    o.has_rise = k > 0;
    field.take(o);
  }
  return score.relative();
}

TEST(LagField, LearnsHowMuchASimulatorLeavesUndone) {
  for (const double share : {0.3, 0.6, 0.9}) {
    LagField field(FieldSettings{});
    EXPECT_LT(lag_error(field, share), 0.01) << share;
    EXPECT_NEAR(field.factors()[0], (1.0 - share) / share, 0.02) << share;
  }
}

TEST(LagField, LeavesASimulatorThatConvergesAsItIs) {
  LagField field(FieldSettings{});
  EXPECT_LT(lag_error(field, 1.0), 0.01);
  EXPECT_NEAR(field.factors()[0], 0.0, 0.02);
}

TEST(LagField, TakesNoSampleWhoseRiseIsNotKnownButAnswersAsTheyAre) {
  LagField field(FieldSettings{});
  Observation o;
  o.force_N = Vector3d(0.0, 0.0, 1.0);
  EXPECT_FALSE(field.take(o).predicted);
  EXPECT_EQ(field.sample_count(), 0);
  o.from_query = true;
  field.take(o);
  EXPECT_EQ(field.sample_count(), 1);
  EXPECT_NEAR(field.read(o.position_m, o.history).force_N.z(), 1.0, 1e-3);
}

// An elastic force F_e through 1 - sum_j g_j / (1 + tau_j s), and a viscosity.
struct RelaxingObject {
  struct Branch {
    double share, time_s;
    Vector3d lag_N = Vector3d::Zero();
  };
  std::vector<Branch> branches;
  double viscosity_Ns_per_m = 0.0;
  Vector3d before_N = Vector3d::Zero();

  Vector3d step(const Vector3d& elastic_N, const Vector3d& velocity_m_per_s, double dt_s) {
    Vector3d force_N = elastic_N - viscosity_Ns_per_m * velocity_m_per_s;
    for (Branch& branch : branches) {
      // Trapezium rule.
      const double x = 0.5 * dt_s / branch.time_s;
      branch.lag_N = ((1.0 - x) * branch.lag_N + x * (elastic_N + before_N)) / (1.0 + x);
      force_N -= branch.share * branch.lag_N;
    }
    before_N = elastic_N;
    return force_N;
  }
};

double relaxation_error(RelaxationField& field, RelaxingObject object) {
  constexpr double kStep_s = 1e-3;
  constexpr int kSteps = 33;
  const AnchoredSprings springs(kSeed);
  const HandMotion hand(kSeed);
  std::array<Vector3d, kPathTerms - 1> low_passed_N;
  low_passed_N.fill(Vector3d::Zero());
  Vector3d force_N = Vector3d::Zero();
  Score score;
  for (int i = 0; i < kSamples * kSteps; ++i) {
    const double time_s = i * kStep_s;
    const Vector3d p = hand.position_m(time_s);
    const Vector3d v = (hand.position_m(time_s + 1e-4) - hand.position_m(time_s)) / 1e-4;
    const Vector3d before_N = force_N;
    force_N = object.step(springs.force_N(p), v, kStep_s);
    PathTerms terms_N;
    terms_N.col(0) = kViscousTerm_Ns_per_m * v;
    for (std::size_t j = 0; j < low_passed_N.size(); ++j) {
      const double x = 0.5 * kStep_s / RelaxationField::kTimeConstants_s[j];
      low_passed_N[j] = ((1.0 - x) * low_passed_N[j] + x * (force_N + before_N)) / (1.0 + x);
      terms_N.col(static_cast<int>(j) + 1) = low_passed_N[j];
    }
    field.observe(terms_N);
    if (i % kSteps == 0) {
      Observation o;
      o.position_m = p;
      o.force_N = force_N;
      o.terms_N = terms_N;
      score.add(i / kSteps, field.read(p, o.history).force_N - force_N, force_N);
      field.take(o);
    }
  }
  return score.relative();
}

// 1 / (1 - g / (1 + tau s)) = 1 + g / (1 - g) / (1 + tau' s), tau' = tau / (1 - g).
TEST(RelaxationField, LearnsAViscosityAndARelaxationOfOneOfItsTimes) {
  RelaxingObject object;
  object.branches = {{0.4, 0.6 * RelaxationField::kTimeConstants_s[1]}};
  object.viscosity_Ns_per_m = 0.0;
  RelaxationField field(FieldSettings{});
  EXPECT_LT(relaxation_error(field, object), 0.01);
  EXPECT_NEAR(field.factors()[0], 0.0, 0.05);
  EXPECT_NEAR(field.factors().tail<3>().sum(), 0.4 / 0.6, 0.1);
  EXPECT_GT(field.factors()[2], 0.5);

  object.branches.clear();
  object.viscosity_Ns_per_m = 3.0;
  RelaxationField viscous(FieldSettings{});
  EXPECT_LT(relaxation_error(viscous, object), 0.01);
  EXPECT_NEAR(viscous.factors()[0], 3.0 / kViscousTerm_Ns_per_m, 0.01);
}

TEST(RelaxationField, MakesUpOtherTimesOfThoseAroundThem) {
  for (const double time_s : {0.04, 0.08, 0.3, 0.8}) {
    RelaxingObject object;
    object.branches = {{0.3, time_s}};
    RelaxationField field(FieldSettings{});
    EXPECT_LT(relaxation_error(field, object), 0.03) << time_s;
  }
}

// Whatever the data, the loop from the felt force to the terms stays stable, and damps.
TEST(RelaxationField, NeverLearnsFactorsThatWouldFeedOnThemselves) {
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal(0.0, 1.0);
  const auto vector = [&](double size) {
    return Vector3d(size * normal(random), size * normal(random), size * normal(random));
  };
  RelaxationField field(FieldSettings{});
  bool limited = false;
  for (int k = 0; k < 300; ++k) {
    Observation o;
    o.position_m = vector(0.008);
    // An object that pushes along with the motion and answers to its own past: no material does.
    for (int j = 0; j < kPathTerms; ++j) {
      o.terms_N.col(j) = vector(1.0);
    }
    o.force_N = -100.0 * o.position_m + 0.5 * o.terms_N.col(0) + 2.0 * o.terms_N.col(1) +
                1.5 * o.terms_N.col(2) + vector(0.1);
    field.take(o);
    const auto& factors = field.factors();
    ASSERT_GE(factors[0], 0.0);
    const double feedback = -factors.tail<3>().cwiseMin(0.0).sum();
    ASSERT_LE(feedback, RelaxationField::kMostFeedback + 1e-12);
    limited = limited || feedback > RelaxationField::kMostFeedback - 1e-9;
  }
  EXPECT_TRUE(limited);
}

TEST(TermsFields, TellTheSlopeOfWhatTheyRead) {
  LagField field(FieldSettings{});
  lag_error(field, 0.6);
  const Vector3d p = HandMotion(kSeed).position_m(4.9);
  Matrix3d slope;
  constexpr double kStep_m = 1e-4;
  for (int a = 0; a < 3; ++a) {
    const Vector3d step = kStep_m * Vector3d::Unit(a);
    slope.col(a) =
        (field.read(p + step, {}).force_N - field.read(p - step, {}).force_N) / (2.0 * kStep_m);
  }
  // Read in single precision: 1e-5 of some newtons, over the step.
  EXPECT_LT((field.stiffness_N_per_m(p, History::Zero()) - slope).norm(), 0.02 * slope.norm());
  EXPECT_GT(field.deviation_N(p, History::Zero()), 0.0);
  EXPECT_LT(field.deviation_N(p, History::Zero()), 0.1);
  EXPECT_GT(field.deviation_N(Vector3d(0.2, 0.0, 0.0), History::Zero()), 1.0);
}

}  // namespace
}  // namespace forcegrid::kriging
