// SPDX-License-Identifier: Apache-2.0
// linear, secant, broyden, rls and tangent on fields for which their answer is known.

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>
#include <string>

#include "forcegrid/methods.h"

namespace forcegrid {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kRounding_N = 1e-12;

std::unique_ptr<ForceMethod> in_contact(const std::string& name) {
  MethodOptions options;
  options.grid.max_W.setConstant(0.1);
  options.grid.cells.setConstant(10);
  auto method = make_force_method(name, options);
  method->contact_made(1, Vector3d::Zero());
  return method;
}

Sample sample_at(double time_s, const Vector3d& position_W, const Vector3d& force_W) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = position_W;
  sample.force_W = force_W;
  return sample;
}

Vector3d force_of(const ForceMethod& method, double time_s, const Vector3d& position_W) {
  const ForceEstimate estimate = method.force(time_s, position_W);
  EXPECT_EQ(estimate.status, EstimateStatus::kOk);
  return estimate.force_W;
}

Matrix3d some_stiffness() {
  Matrix3d stiffness;
  stiffness << -50.0, 1.0, 2.0, 3.0, -60.0, 4.0, 5.0, 6.0, -110.0;
  return stiffness;
}

TEST(LinearMethod, ContinuesTheLineThroughTheTwoNewestSamplesForAQuarterSecond) {
  const auto method = in_contact("linear");
  const Vector3d rate_N_per_s(1.0, -2.0, 3.0);
  method->take_sample(sample_at(1.0, Vector3d::Zero(), Vector3d(5, 5, 5)));
  EXPECT_EQ(force_of(*method, 1.1, Vector3d::Zero()), Vector3d(5, 5, 5));
  method->take_sample(sample_at(1.5, Vector3d::Zero(), Vector3d(5, 5, 5) + 0.5 * rate_N_per_s));
  for (const double ahead_s : {0.0, 0.1, 0.25}) {
    const Vector3d expected_N = Vector3d(5, 5, 5) + (0.5 + ahead_s) * rate_N_per_s;
    EXPECT_LT((force_of(*method, 1.5 + ahead_s, Vector3d(1, 2, 3)) - expected_N).norm(),
              kRounding_N);
  }
  const Vector3d held_N = Vector3d(5, 5, 5) + 0.75 * rate_N_per_s;
  EXPECT_LT((force_of(*method, 100.0, Vector3d::Zero()) - held_N).norm(), kRounding_N);
}

TEST(LinearMethod, TakesASecondSampleOfOneTimeWithoutASlopeOfItsOwn) {
  const auto method = in_contact("linear");
  method->take_sample(sample_at(1.0, Vector3d::Zero(), Vector3d(0, 0, 0)));
  method->take_sample(sample_at(2.0, Vector3d::Zero(), Vector3d(1, 0, 0)));
  method->take_sample(sample_at(2.0, Vector3d::Zero(), Vector3d(5, 0, 0)));
  EXPECT_NEAR(force_of(*method, 2.1, Vector3d::Zero()).x(), 5.1, kRounding_N);
}

TEST(SecantMethod, KnowsTheSlopeAlongTheLastStepAndNoneAcrossIt) {
  const auto method = in_contact("secant");
  const Matrix3d stiffness = some_stiffness();
  const Vector3d along(0.002, 0.0, 0.0);
  const Vector3d across(0.0, 0.002, 0.0);
  method->take_sample(sample_at(0.0, Vector3d::Zero(), Vector3d::Zero()));
  EXPECT_EQ(force_of(*method, 0.0, along), Vector3d::Zero());
  method->take_sample(sample_at(0.1, along, stiffness * along));
  EXPECT_LT((force_of(*method, 0.1, 3.0 * along) - 3.0 * stiffness * along).norm(), kRounding_N);
  EXPECT_LT((force_of(*method, 0.1, along + across) - stiffness * along).norm(), kRounding_N);
  // The next step replaces the slope.
  method->take_sample(sample_at(0.2, along + across, stiffness * (along + across)));
  EXPECT_LT((force_of(*method, 0.2, 5.0 * along + across) - stiffness * (along + across)).norm(),
            kRounding_N);
}

TEST(BroydenMethod, LearnsALinearSpringInThreeStepsAndKeepsIt) {
  const auto method = in_contact("broyden");
  const Matrix3d stiffness = some_stiffness();
  Vector3d position_W(0.01, 0.02, 0.03);
  method->take_sample(sample_at(0.0, position_W, stiffness * position_W));
  for (int axis = 0; axis < 3; ++axis) {
    position_W += 0.004 * Vector3d::Unit(axis);
    method->take_sample(sample_at(1.0 + axis, position_W, stiffness * position_W));
  }
  const Vector3d elsewhere_W(-0.02, 0.05, 0.01);
  EXPECT_LT((force_of(*method, 4.0, elsewhere_W) - stiffness * elsewhere_W).norm(), kRounding_N);
  position_W -= Vector3d(0.003, 0.003, 0.003);
  method->take_sample(sample_at(4.0, position_W, stiffness * position_W));
  EXPECT_LT((force_of(*method, 4.0, elsewhere_W) - stiffness * elsewhere_W).norm(), kRounding_N);
}

TEST(BroydenAndSecant, LearnNothingFromAStepOfLessThanHalfAMillimetre) {
  for (const char* name : {"broyden", "secant"}) {
    const auto method = in_contact(name);
    method->take_sample(sample_at(0.0, Vector3d::Zero(), Vector3d::Zero()));
    method->take_sample(sample_at(0.1, Vector3d(0.002, 0, 0), Vector3d(-0.2, 0, 0)));
    // 0.4 mm with a force that would mean -10,000 N/m.
    method->take_sample(sample_at(0.2, Vector3d(0.0024, 0, 0), Vector3d(-4.2, 0, 0)));
    EXPECT_NEAR(force_of(*method, 0.2, Vector3d(0.0034, 0, 0)).x(), -4.3, kRounding_N) << name;
    method->take_sample(sample_at(0.3, Vector3d(0.0030, 0, 0), Vector3d(-4.8, 0, 0)));
    EXPECT_NEAR(force_of(*method, 0.3, Vector3d(0.0040, 0, 0)).x(), -5.8, 1e-9) << name;
  }
}

TEST(TangentMethod, FollowsTheStiffnessOfTheNewestSampleFromTheFirstOn) {
  const auto method = in_contact("tangent");
  EXPECT_TRUE(method->needs().stiffness);
  const Vector3d here_W(0.01, 0.02, 0.03);
  const Vector3d there_W(0.012, 0.018, 0.031);
  Sample sample = sample_at(0.0, here_W, Vector3d(1, 2, 3));
  method->take_sample(sample);
  EXPECT_EQ(method->force(0.0, here_W).status, EstimateStatus::kUnknown) << "without stiffness";
  sample.has_stiffness = true;
  sample.stiffness_W = some_stiffness();
  method->take_sample(sample);
  const Vector3d expected_N = Vector3d(1, 2, 3) + some_stiffness() * (there_W - here_W);
  EXPECT_LT((force_of(*method, 0.0, there_W) - expected_N).norm(), kRounding_N);
}

// Ridge and forgetting bend the fit by some 1e-3 of the field, the anchor nothing.
TEST(RlsMethod, LearnsAQuadraticFieldAndMeetsItsNewestSampleExactly) {
  const unsigned seed = 5;
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> within(-0.02, 0.02);
  const auto random_position = [&] {
    const double x = within(generator);
    const double y = within(generator);
    return Vector3d(x, y, within(generator));
  };
  const Vector3d centre_W(0.08, 0.06, 0.05);
  const auto field = [&](const Vector3d& position_W) {
    const Vector3d d = position_W - centre_W;
    return Vector3d(-50.0 * d.x() + 800.0 * d.x() * d.x() - 300.0 * d.y() * d.z(),
                    -60.0 * d.y() + 500.0 * d.x() * d.y(),
                    -110.0 * d.z() - 1500.0 * d.z() * d.z() + 400.0 * d.x() * d.z());
  };
  const auto method = in_contact("rls");
  Vector3d newest_W = centre_W;
  for (int i = 0; i < 200; ++i) {
    method->take_sample(sample_at(0.03 * i, newest_W, field(newest_W)));
    EXPECT_LT((force_of(*method, 0.03 * i, newest_W) - field(newest_W)).norm(), 1e-9);
    newest_W = centre_W + random_position();
  }
  double error_squared = 0.0;
  double field_squared = 0.0;
  for (int i = 0; i < 200; ++i) {
    const Vector3d position_W = centre_W + random_position();
    error_squared += (force_of(*method, 7.0, position_W) - field(position_W)).squaredNorm();
    field_squared += field(position_W).squaredNorm();
  }
  EXPECT_LT(std::sqrt(error_squared / field_squared), 2e-3);
}

TEST(RlsMethod, ForgetsAStiffnessThatIsNoLongerTrue) {
  const auto method = in_contact("rls");
  const auto feel = [&](double stiffness_N_per_m, int from, int to) {
    for (int i = from; i < to; ++i) {
      const double x_m = 0.01 * std::sin(0.7 * i);
      method->take_sample(
          sample_at(0.03 * i, Vector3d(x_m, 0, 0), Vector3d(-stiffness_N_per_m * x_m, 0, 0)));
    }
  };
  const auto stiffness_N_per_m = [&] {
    return -(force_of(*method, 20.0, Vector3d(0.005, 0, 0)) -
             force_of(*method, 20.0, Vector3d(-0.005, 0, 0)))
                .x() /
           0.01;
  };
  feel(100.0, 0, 100);
  EXPECT_NEAR(stiffness_N_per_m(), 100.0, 1.0);
  feel(50.0, 100, 300);  // 0.97^200 = 0.002 of the old is left
  EXPECT_NEAR(stiffness_N_per_m(), 50.0, 1.0);
}

TEST(SimpleMethods, IgnoreLateSamplesAndAnswersToOthersRequests) {
  for (const char* name : {"hold", "linear", "secant", "broyden", "rls", "tangent"}) {
    SCOPED_TRACE(name);
    const auto method = in_contact(name);
    const auto pulled_at = [](double time_s, double x_m, double force_N) {
      Sample sample = sample_at(time_s, Vector3d(x_m, 0, 0), Vector3d(force_N, 0, 0));
      sample.has_stiffness = true;
      sample.stiffness_W = -100.0 * Matrix3d::Identity();
      return sample;
    };
    method->take_sample(pulled_at(0.1, 0.001, -0.1));
    method->take_sample(pulled_at(0.2, 0.003, -0.3));
    const Vector3d before_N = force_of(*method, 0.25, Vector3d(0.004, 0, 0));
    method->take_sample(pulled_at(0.15, 0.002, 9.0));
    Sample answer = pulled_at(0.3, 0.002, 9.0);
    answer.from_query = true;
    method->take_sample(answer);
    EXPECT_EQ(force_of(*method, 0.25, Vector3d(0.004, 0, 0)), before_N);
  }
}

TEST(SimpleMethods, SayWhenAForceIsBeyondNumbers) {
  for (const char* name : {"linear", "secant", "broyden", "rls", "tangent"}) {
    SCOPED_TRACE(name);
    const auto method = in_contact(name);
    for (const double time_s : {0.1, 0.2, 0.3}) {
      Sample sample = sample_at(time_s, Vector3d(time_s, 0, 0), Vector3d(1e305 * time_s, 0, 0));
      sample.has_stiffness = true;
      sample.stiffness_W = 1e305 * Matrix3d::Identity();
      method->take_sample(sample);
    }
    const ForceEstimate estimate = method->force(1e9, Vector3d::Constant(1e200));
    if (estimate.status == EstimateStatus::kOk) {
      EXPECT_STREQ(name, "linear");  // it looks at the time only, and not far ahead
      EXPECT_TRUE(estimate.force_W.allFinite());
    } else {
      EXPECT_EQ(estimate.status, EstimateStatus::kNotFinite);
      EXPECT_EQ(estimate.force_W, Vector3d::Zero());
    }
  }
}

}  // namespace
}  // namespace forcegrid
