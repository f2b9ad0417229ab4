// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/unilateral_constraint.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "forcegrid/kriging/ensemble_method.h"
#include "forcegrid/kriging/unilateral_constraint_field.h"
#include "forcegrid/methods.h"
#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using testing::AnchoredSprings;
using testing::HandMotion;

constexpr unsigned kSeed = 7;
constexpr double kPeriod_s = 1.0 / 30.0;
const History kNoHistory = History::Zero();

using Force = std::function<Vector3d(const Vector3d& position_m)>;

Vector3d force_N(const Field& field, const Vector3d& p) {
  return field.read(p, kNoHistory).force_N;
}

Observation observe(const Vector3d& position_m, const Vector3d& force_N) {
  Observation o;
  o.position_m = position_m;
  o.force_N = force_N;
  return o;
}

/// Takes an observation and does all that it has left.
Innovation take_whole(Field& field, const Observation& o) {
  const Innovation innovation = field.take(o);
  while (field.prepare()) {
  }
  return innovation.unfinished ? field.taken() : innovation;
}

/// A hard wall through `surface_m`, pushing against `normal`; beyond it k1 s + k2 s^2.
Vector3d plane_N(const Vector3d& p, const Vector3d& normal, const Vector3d& surface_m, double k1,
                 double k2 = 0.0) {
  const double s_m = std::max(0.0, normal.dot(p - surface_m));
  return -(k1 * s_m + k2 * s_m * s_m) * normal;
}

Vector3d ball_N(const Vector3d& p, const Vector3d& centre_m, double radius_m, double k1) {
  const Vector3d from_centre_m = p - centre_m;
  const double s_m = std::max(0.0, radius_m - from_centre_m.norm());
  return k1 * s_m * from_centre_m.normalized();
}

TEST(UnilateralConstraint, IsABallOrThePlaneThatTouchesIt) {
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  RecordProperty("seed", static_cast<int>(kSeed));
  const auto somewhere = [&] {
    return Vector3d(0.02 * Vector3d(uniform(random), uniform(random), uniform(random)));
  };
  for (int i = 0; i < 50; ++i) {
    UnilateralConstraint constraint;
    constraint.anchor_W = somewhere();
    constraint.normal_W = somewhere().normalized();
    constraint.depth_m = 0.003 * uniform(random);
    const Vector3d surface_m = constraint.anchor_W - constraint.depth_m * constraint.normal_W;
    const Vector3d p = somewhere();
    const double straight_m = constraint.normal_W.dot(p - surface_m);
    EXPECT_NEAR(constraint.at(p).depth_m, straight_m, 1e-12);
    EXPECT_LT((constraint.at(p).inward_W - constraint.normal_W).norm(), 1e-12);
    EXPECT_NEAR(constraint.at(constraint.anchor_W).depth_m, constraint.depth_m, 1e-12);
    for (const double radius_m : {0.05, -0.08, 1e5}) {
      constraint.curvature_per_m = 1.0 / radius_m;
      const Vector3d centre_m = surface_m + radius_m * constraint.normal_W;
      const double inside_m =
          radius_m > 0.0 ? radius_m - (p - centre_m).norm() : (p - centre_m).norm() + radius_m;
      EXPECT_NEAR(constraint.at(p).depth_m, inside_m, 1e-10 + 1e-16 * std::abs(radius_m) / 1e-10);
      EXPECT_NEAR(constraint.at(constraint.anchor_W).depth_m, constraint.depth_m, 1e-10);
      Vector3d slope;
      constexpr double kStep_m = 1e-7;
      for (int a = 0; a < 3; ++a) {
        const Vector3d step = kStep_m * Vector3d::Unit(a);
        slope[a] =
            (constraint.at(p + step).depth_m - constraint.at(p - step).depth_m) / (2.0 * kStep_m);
      }
      EXPECT_LT((constraint.at(p).inward_W - slope).norm(), 1e-6);
    }
  }
}

TEST(UnilateralConstraint, HasAnEdgeAsSoftAsItSays) {
  UnilateralConstraint constraint;
  constraint.softness_m = 5e-4;
  EXPECT_NEAR(constraint.at(Vector3d::Zero()).penetration_m, 5e-4 * std::log(2.0), 1e-12);
  EXPECT_NEAR(
      constraint.at({0, 0, 1e-3}).penetration_m - constraint.at({0, 0, -1e-3}).penetration_m, 1e-3,
      1e-12);
  EXPECT_NEAR(constraint.at({0, 0, 0.02}).penetration_m, 0.02, 1e-9);
  EXPECT_EQ(constraint.at({0, 0, -0.02}).penetration_m, 0.0);
}

TEST(UnilateralConstraintField, EqualsADenseSolveWithColumnsForItsconstraints) {
  const AnchoredSprings object(kSeed, 0.2);
  UnilateralConstraint flat;
  flat.depth_m = -0.004;
  UnilateralConstraint ball;
  ball.normal_W = Vector3d::UnitX();
  ball.depth_m = -0.006;
  ball.curvature_per_m = 40.0;
  ball.softness_m = 3e-4;
  const std::array<UnilateralConstraint, 2> constraints = {flat, ball};
  FieldSettings settings;
  settings.surprise = 1e300;  // the constraints are given
  settings.spacing.metres = 1e-9;
  settings.nugget_N2 = 1e-4;
  UnilateralConstraintField<double> field(settings);
  std::mt19937 random(kSeed);
  RecordProperty("seed", static_cast<int>(kSeed));
  std::uniform_real_distribution<double> uniform(-0.012, 0.012);
  std::vector<Vector3d> at;
  Eigen::VectorXd f(3 * 24);
  for (int i = 0; i < 24; ++i) {
    at.emplace_back(uniform(random), uniform(random), uniform(random));
    Vector3d force = 0.2 * object.force_N(at.back());
    for (const UnilateralConstraint& constraint : constraints) {
      const UnilateralConstraint::At there = constraint.at(at.back());
      force -= (50.0 * there.penetration_m + 3e3 * there.penetration_m * there.penetration_m) *
               there.inward_W;
    }
    f.segment<3>(3 * i) = force;
    take_whole(field, observe(at.back(), force));
  }
  ASSERT_EQ(field.sample_count(), 24);
  ASSERT_EQ(field.constraint_count(), 0);
  field.set_constraints(constraints);
  ASSERT_EQ(field.constraint_count(), 2);

  const auto covariance = [&](const Vector3d& p, const Vector3d& q, std::size_t first,
                              std::size_t count) {
    Matrix3d k = settings.kernel.force_force(p, kNoHistory, q, kNoHistory);
    for (std::size_t h = first; h < first + count; ++h) {
      const UnilateralConstraint::At a = constraints[h].at(p);
      const UnilateralConstraint::At b = constraints[h].at(q);
      const double linear = a.penetration_m * b.penetration_m;
      k += (1e6 * linear + 9e8 * linear * linear) * a.inward_W * b.inward_W.transpose();
    }
    return k;
  };
  const auto dense = [&](std::size_t first, std::size_t count) {
    Eigen::MatrixXd k(f.size(), f.size());
    for (int i = 0; i < 24; ++i) {
      for (int j = 0; j < 24; ++j) {
        k.block<3, 3>(3 * i, 3 * j) = covariance(at[static_cast<std::size_t>(i)],
                                                 at[static_cast<std::size_t>(j)], first, count);
      }
    }
    k.diagonal().array() += settings.nugget_N2;
    return Eigen::LLT<Eigen::MatrixXd>(k);
  };
  const Eigen::LLT<Eigen::MatrixXd> both = dense(0, 2);
  const Eigen::VectorXd alpha = both.solve(f);
  const double scale = std::max(1.0, f.dot(alpha) / static_cast<double>(f.size()));
  for (int i = 0; i < 20; ++i) {
    const Vector3d p(uniform(random), uniform(random), uniform(random));
    Eigen::MatrixXd cross(3, f.size());
    for (int j = 0; j < 24; ++j) {
      cross.block<3, 3>(0, 3 * j) = covariance(p, at[static_cast<std::size_t>(j)], 0, 2);
    }
    EXPECT_LT((force_N(field, p) - cross * alpha).norm(), 1e-7);
    const Matrix3d posterior = covariance(p, p, 0, 2) - cross * both.solve(cross.transpose());
    EXPECT_NEAR(field.deviation_N(p, kNoHistory), std::sqrt(scale * posterior.trace() / 3.0),
                1e-5 * field.deviation_N(p, kNoHistory) + 1e-7);
  }
  // The gain is the difference of the logarithms of the evidence, in units of the data's scale
  // before there were constraints.
  const double scale_before =
      std::max(1.0, f.dot(dense(0, 0).solve(f)) / static_cast<double>(f.size()));
  const auto evidence_nats = [&](const Eigen::LLT<Eigen::MatrixXd>& k) {
    return -0.5 * f.dot(k.solve(f)) / scale_before - k.matrixLLT().diagonal().array().log().sum();
  };
  for (std::size_t h = 0; h < 2; ++h) {
    const double bent = constraints[h].curvature_per_m / 40.0;
    const double soft = std::log(constraints[h].softness_m / 5e-5) / 1.5;
    EXPECT_NEAR(
        field.constraint_gain(static_cast<int>(h)),
        evidence_nats(both) - evidence_nats(dense(1 - h, 1)) - 0.5 * (bent * bent + soft * soft),
        1e-4);
  }
}

struct Explored {
  int touches = 0;     ///< samples beyond the wall
  double error = 0.0;  ///< RMS of the predictions from the third touch on, of the force's RMS
  int most_constraints = 0;
};

// Samples along a hand's motion, each predicted before the field takes it.
Explored explore(UnilateralConstraintField<double>& field, const Force& object_N,
                 const Force& wall_N, int samples, unsigned seed, double noise_N = 0.0) {
  const HandMotion motion(seed);
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, noise_N);
  Explored result;
  double squares_N2 = 0.0;
  double reference_N2 = 0.0;
  for (int i = 0; i < samples; ++i) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    const Vector3d reference_N = object_N(p) + wall_N(p);
    if (result.touches > 2) {
      squares_N2 += (force_N(field, p) - reference_N).squaredNorm();
      reference_N2 += reference_N.squaredNorm();
    }
    result.touches += wall_N(p) != Vector3d::Zero() ? 1 : 0;
    const Vector3d wrong_N = noise_N > 0.0 ? Vector3d(noise(random), noise(random), noise(random))
                                           : Vector3d(Vector3d::Zero());
    take_whole(field, observe(p, reference_N + wrong_N));
    result.most_constraints = std::max(result.most_constraints, field.constraint_count());
  }
  result.error = std::sqrt(squares_N2 / reference_N2);
  return result;
}

TEST(UnilateralConstraintField, FindsAPlaneAndItsStiffness) {
  const AnchoredSprings object(kSeed, 0.3);
  for (const unsigned seed : {1u, 2u, 3u, 4u}) {
    for (const double k : {500.0, 1000.0, 3000.0}) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << ", " << k << " N/m");
      const Vector3d normal = Vector3d(0.3 * seed, -0.2, 1.0).normalized();
      const Vector3d surface_m = 0.003 * normal;
      UnilateralConstraintField<double> field{FieldSettings{}};
      const Explored explored = explore(
          field, [&](const Vector3d& p) { return object.force_N(p); },
          [&](const Vector3d& p) { return plane_N(p, normal, surface_m, k); }, 300, seed);
      ASSERT_GT(explored.touches, 20);
      EXPECT_LT(explored.error, 0.01);
      ASSERT_EQ(field.constraint_count(), 1);
      EXPECT_GT(field.constraint_gain(0), 15.0);
      const UnilateralConstraint::At there = field.constraint(0).at(surface_m);
      EXPECT_LT((there.inward_W - normal).norm(), 0.01);
      EXPECT_NEAR(there.depth_m, 0.0, 1e-4);
      constexpr double kDeep_m = 0.003;
      const Eigen::Vector2d found = field.constraint_stiffness(0);
      EXPECT_NEAR(-(found[0] + found[1] * kDeep_m), k, 0.02 * k);
    }
  }
}

TEST(UnilateralConstraintField, FindsABallFromTheForcesOnIt) {
  const AnchoredSprings object(kSeed);
  for (const unsigned seed : {1u, 2u, 3u}) {
    SCOPED_TRACE(seed);
    const Vector3d centre_m(0.002, -0.003, 0.024);
    constexpr double kRadius_m = 0.020;
    UnilateralConstraintField<double> field{FieldSettings{}};
    const Explored explored = explore(
        field, [&](const Vector3d& p) { return object.force_N(p); },
        [&](const Vector3d& p) { return ball_N(p, centre_m, kRadius_m, 1000.0); }, 400, seed);
    ASSERT_GT(explored.touches, 20);
    EXPECT_LT(explored.error, 0.01);
    ASSERT_EQ(field.constraint_count(), 1);
    EXPECT_NEAR(field.constraint(0).curvature_per_m, 1.0 / kRadius_m, 0.05 / kRadius_m);
    const UnilateralConstraint& constraint = field.constraint(0);
    const Vector3d found_m =
        constraint.anchor_W +
        (1.0 / constraint.curvature_per_m - constraint.depth_m) * constraint.normal_W;
    EXPECT_LT((found_m - centre_m).norm(), 1e-3);
    // Its derivative, in front of the ball and in it.
    for (const double depth_m : {-0.002, 0.0005, 0.002}) {
      const Vector3d p = centre_m + (kRadius_m - depth_m) * Vector3d(0.1, -0.2, -1.0).normalized();
      const Matrix3d j = field.stiffness_N_per_m(p, kNoHistory);
      for (int axis = 0; axis < 3; ++axis) {
        const Vector3d step = 1e-7 * Vector3d::Unit(axis);
        EXPECT_LT(
            (j.col(axis) - (force_N(field, p + step) - force_N(field, p - step)) / 2e-7).norm(),
            1e-4 * j.norm());
      }
    }
  }
}

TEST(UnilateralConstraintField, FindsTwoWallsAndReplacesOneThatDoesNotHold) {
  const AnchoredSprings object(kSeed);
  for (const unsigned seed : {1u, 2u, 3u}) {
    SCOPED_TRACE(seed);
    UnilateralConstraintField<double> field{FieldSettings{}};
    const Explored explored = explore(
        field, [&](const Vector3d& p) { return object.force_N(p); },
        [&](const Vector3d& p) {
          return Vector3d(plane_N(p, Vector3d::UnitZ(), Vector3d(0, 0, 0.004), 1000.0) +
                          plane_N(p, Vector3d::UnitX(), Vector3d(0.005, 0, 0), 700.0));
        },
        500, seed);
    ASSERT_GT(explored.touches, 40);
    ASSERT_EQ(field.constraint_count(), 2);
    const int up = field.constraint(0).normal_W.z() > field.constraint(1).normal_W.z() ? 0 : 1;
    EXPECT_LT((field.constraint(up).at({0, 0, 0.006}).inward_W - Vector3d::UnitZ()).norm(), 0.01);
    EXPECT_LT((field.constraint(1 - up).at({0.007, 0, 0}).inward_W - Vector3d::UnitX()).norm(),
              0.01);
  }
}

// For any samples: a wall that softens, one that sticks, noise, an object that is cut.
TEST(UnilateralConstraintField, NeverPulls) {
  const AnchoredSprings object(kSeed);
  const Force objects[] = {
      [&](const Vector3d& p) { return object.force_N(p); },
      [&](const Vector3d& p) { return Vector3d((p.x() > 0.0 ? 0.5 : 1.0) * object.force_N(p)); }};
  const Force walls[] = {
      [](const Vector3d& p) {
        return plane_N(p, Vector3d::UnitZ(), Vector3d(0, 0, 0.004), 800.0, -9e4);
      },
      [](const Vector3d& p) {
        return plane_N(p, Vector3d::UnitZ(), Vector3d(0, 0, 0.004), -600.0);
      },
      [](const Vector3d& p) {
        return Vector3d(p.z() > 0.004 ? Vector3d(0.0, 2.0, 1.0) : Vector3d::Zero());
      }};
  int constraints = 0;
  for (const Force& object_N : objects) {
    for (const Force& wall_N : walls) {
      UnilateralConstraintField<double> field{FieldSettings{}};
      const HandMotion motion(kSeed);
      std::mt19937 random(kSeed);
      std::normal_distribution<double> noise(0.0, 0.05);
      for (int i = 0; i < 200; ++i) {
        const Vector3d p = motion.position_m(i * kPeriod_s);
        take_whole(field, observe(p, object_N(p) + wall_N(p) +
                                         Vector3d(noise(random), noise(random), noise(random))));
        for (int h = 0; h < field.constraint_count(); ++h) {
          ++constraints;
          const Eigen::Vector2d k = field.constraint_stiffness(h);
          EXPECT_LE(k[0], 0.0);
          for (int j = 0; j <= i; ++j) {
            const double deep_m =
                field.constraint(h).at(motion.position_m(j * kPeriod_s)).penetration_m;
            const double newest_m = field.constraint(h).at(p).penetration_m;
            if (deep_m <= newest_m) {
              EXPECT_LE(k[0] + k[1] * deep_m, 0.0);
            }
          }
        }
      }
    }
  }
  EXPECT_GT(constraints, 100) << "nothing was checked";
}

TEST(UnilateralConstraintField, IsTheFieldWithoutConstraintsOnASmoothObjectWithNoise) {
  for (const unsigned seed : {1u, 2u, 3u, 4u, 5u}) {
    const AnchoredSprings object(seed);
    for (const double noise_N : {0.0, 0.010}) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << ", noise " << noise_N << " N");
      UnilateralConstraintField<double> field{FieldSettings{}};
      DictionaryField<double, 48, 0> without{FieldSettings{}};
      const HandMotion motion(seed);
      std::mt19937 random(seed);
      std::normal_distribution<double> noise(0.0, 1.0);
      for (int i = 0; i < 300; ++i) {
        const Vector3d p = motion.position_m(i * kPeriod_s);
        const Vector3d told_N =
            object.force_N(p) + noise_N * Vector3d(noise(random), noise(random), noise(random));
        take_whole(field, observe(p, told_N));
        without.take(observe(p, told_N));
        ASSERT_EQ(field.constraint_count(), 0) << "sample " << i;
        const Vector3d ahead = motion.position_m((i + 1) * kPeriod_s);
        ASSERT_LT((force_N(field, ahead) - force_N(without, ahead)).norm(), 1e-9);
      }
    }
  }
}

TEST(UnilateralConstraintField, DropsAWallThatHasGone) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  UnilateralConstraintField<double> field{FieldSettings{}};
  double squares_N2 = 0.0;
  double reference_N2 = 0.0;
  for (int i = 0; i < 500; ++i) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    Vector3d reference_N = object.force_N(p);
    if (i < 250) {
      reference_N += plane_N(p, Vector3d::UnitZ(), Vector3d(0, 0, 0.003), 1000.0);
    }
    if (i == 249) {
      EXPECT_EQ(field.constraint_count(), 1);
    }
    if (i > 350) {
      squares_N2 += (force_N(field, p) - reference_N).squaredNorm();
      reference_N2 += reference_N.squaredNorm();
    }
    take_whole(field, observe(p, reference_N));
  }
  EXPECT_EQ(field.constraint_count(), 0);
  EXPECT_LT(std::sqrt(squares_N2 / reference_N2), 0.03);
}

// The object is grabbed elsewhere; the wall is where it was.
TEST(UnilateralConstraintField, LeavesAWallWhereItIsWhenTheContactMoves) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const Vector3d normal = Vector3d(0.3, 0.0, 1.0).normalized();
  const auto wall_N = [&](const Vector3d& position_W) {
    return plane_N(position_W, normal, Vector3d(0.1, 0.05, 0.05) + 0.004 * normal, 1000.0);
  };
  UnilateralConstraintField<double> field{FieldSettings{}};
  const Vector3d first_W(0.1, 0.05, 0.05);
  const Vector3d second_W(0.105, 0.048, 0.053);
  field.enter_contact(1, first_W);
  for (int i = 0; i < 300; ++i) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    Observation o = observe(p, object.force_N(p) + wall_N(first_W + p));
    o.origin_W = first_W;
    take_whole(field, o);
  }
  ASSERT_EQ(field.constraint_count(), 1);
  field.enter_contact(2, second_W);
  double squares_N2 = 0.0;
  double reference_N2 = 0.0;
  double pushed_N2 = 0.0;
  const auto compare = [&](const Vector3d& p) {
    const Vector3d reference_N = object.force_N(p) + wall_N(second_W + p);
    squares_N2 += (force_N(field, p) - reference_N).squaredNorm();
    reference_N2 += reference_N.squaredNorm();
    pushed_N2 += wall_N(second_W + p).squaredNorm();
    return reference_N;
  };
  for (int i = 0; i < 200; ++i) {
    compare(motion.position_m(i * kPeriod_s));
  }
  EXPECT_GT(pushed_N2, 0.1 * reference_N2);
  EXPECT_LT(std::sqrt(squares_N2 / reference_N2), 0.01)
      << "before any sample of the second contact";
  squares_N2 = reference_N2 = 0.0;
  for (int i = 0; i < 100; ++i) {
    const Vector3d p = motion.position_m((300 + i) * kPeriod_s);
    Observation o = observe(p, compare(p));
    o.origin_W = second_W;
    o.contact = 1;
    take_whole(field, o);
    EXPECT_EQ(field.constraint_count(), 1);
  }
  EXPECT_LT(std::sqrt(squares_N2 / reference_N2), 0.01);
}

TEST(UnilateralConstraint, FeelsAWallWhereKrigingSmoothsIt) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const Vector3d point_W(0.08, 0.06, 0.05);
  std::map<std::string, double> error;
  for (const std::string name : {"kriging", "kriging-hinge", "kriging-bank"}) {
    const auto method = make_force_method(name, {});
    method->contact_made(1, point_W);
    double squares_N2 = 0.0;
    double reference_N2 = 0.0;
    for (int i = 0; i < 6000; ++i) {
      const double t_s = 0.002 * i;
      const Vector3d p = motion.position_m(t_s);
      const Vector3d reference_N =
          object.force_N(p) + plane_N(p, Vector3d::UnitZ(), Vector3d(0, 0, 0.005), 1000.0);
      method->observe(t_s, point_W + p);
      if (i >= 2000) {
        squares_N2 += (method->force(t_s, point_W + p).force_W - reference_N).squaredNorm();
        reference_N2 += reference_N.squaredNorm();
      }
      if (i % 17 == 0) {
        Sample sample;
        sample.time_s = t_s;
        sample.position_W = point_W + p;
        sample.force_W = reference_N;
        method->take_sample(sample);
        method->work(1 << 30);
      }
    }
    error[name] = std::sqrt(squares_N2 / reference_N2);
    if (name == "kriging-bank") {
      EXPECT_STREQ(method->candidates()[method->force(12.0, point_W).candidate], "walls");
    }
  }
  EXPECT_GT(error["kriging"], 0.03);
  EXPECT_LT(error["kriging-hinge"], 0.005);
  EXPECT_LT(error["kriging-bank"], 0.005);
}

// A wall may be sought for in many cycles; nothing that is rendered changes until it is found.
TEST(UnilateralConstraintField, SeeksInBoundedPiecesAndAnswersAsBefore) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const Vector3d surface_m(0, 0, 0.005);
  const std::vector<Vector3d> probes = {
      {0, 0, 0}, {0.004, -0.002, 0.001}, {-0.003, 0.005, 0.008}, {0.002, 0.002, 0.02}};
  UnilateralConstraintField<double> field{FieldSettings{}};
  int searches = 0;
  for (int i = 0; i < 300 && field.constraint_count() == 0; ++i) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    const Vector3d wall_N = plane_N(p, Vector3d::UnitZ(), surface_m, 1000.0);
    std::vector<Vector3d> before_N;
    for (const Vector3d& probe : probes) {
      before_N.push_back(force_N(field, probe));
    }
    const Observation o = observe(p, object.force_N(p) + wall_N);
    if (!field.take(o).unfinished) {
      continue;
    }
    ++searches;
    int pieces = 1;
    for (; !field.ready() && pieces < 100; ++pieces) {
      EXPECT_FALSE(field.knows_walls());
      for (std::size_t j = 0; j < probes.size(); ++j) {
        EXPECT_EQ(force_N(field, probes[j]), before_N[j]) << "piece " << pieces;
      }
      EXPECT_TRUE(std::isfinite(field.deviation_N(probes[1], kNoHistory)));
      EXPECT_TRUE(field.prepare());
    }
    EXPECT_GT(pieces, 2);
    EXPECT_LT(pieces, 100);
    EXPECT_FALSE(field.prepare());
    EXPECT_FALSE(field.taken().unfinished);
    EXPECT_TRUE(field.taken().surprised);
    EXPECT_EQ(field.taken().explained, field.constraint_count() == 1);
  }
  EXPECT_GT(searches, 0);
  EXPECT_EQ(field.constraint_count(), 1);
}

// Answers that lag are many and surprise as a wall does; the servo must bear their searches, too.
TEST(UnilateralConstraintField, SeeksInSmallerPiecesWhereTheSimulatorHasNotConverged) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const auto pieces_of_first_search = [&](bool unfinished) {
    UnilateralConstraintField<double> field{FieldSettings{}};
    for (int i = 0; i < 300; ++i) {
      const Vector3d p = motion.position_m(i * kPeriod_s);
      const Vector3d wall_N = plane_N(p, Vector3d::UnitZ(), {0, 0, 0.005}, 1000.0);
      Observation o = observe(p, object.force_N(p) + wall_N);
      o.unfinished = unfinished;
      if (field.take(o).unfinished) {
        int pieces = 1;
        while (field.prepare()) {
          ++pieces;
        }
        return std::pair(pieces, field.constraint_count());
      }
    }
    return std::pair(0, 0);
  };
  const auto [swift, found] = pieces_of_first_search(false);
  const auto [small, found_late] = pieces_of_first_search(true);
  EXPECT_GT(swift, 0);
  EXPECT_GT(small, swift);
  EXPECT_EQ(found_late, found);
}

// A sample is fitted at once; the shapes of the walls are refined in pieces, which need not wait
// for one another, and nobody sees them half refined.
TEST(UnilateralConstraintField, RefinesItsWallsInPieces) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const auto told = [&](int i) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    return observe(p, object.force_N(p) + plane_N(p, Vector3d::UnitZ(), {0, 0, 0.005}, 1000.0));
  };
  const Vector3d beyond_m(0.001, 0.002, 0.009);
  UnilateralConstraintField<double> field{FieldSettings{}};
  UnilateralConstraintField<double> at_the_next{FieldSettings{}};
  int refined = 0;
  int moved = 0;
  int most_pieces = 0;
  for (int i = 0; i < 300; ++i) {
    const bool searches = field.take(told(i)).unfinished;
    at_the_next.take(told(i));
    const bool knew = field.knows_walls() && !searches;
    EXPECT_TRUE(!knew || (force_N(field, told(i).position_m) - told(i).force_N).norm() < 0.3);
    const Vector3d first_N = force_N(field, beyond_m);
    int pieces = 0;
    while (!field.ready()) {
      EXPECT_TRUE(searches || force_N(field, beyond_m) == first_N) << "piece " << pieces;
      EXPECT_TRUE(field.prepare());
      ++pieces;
    }
    EXPECT_FALSE(field.prepare());
    refined += knew && pieces > 0 ? 1 : 0;
    moved += knew && force_N(field, beyond_m) != first_N ? 1 : 0;
    most_pieces = std::max(most_pieces, searches ? 0 : pieces);
  }
  EXPECT_GT(refined, 100);
  EXPECT_GT(moved, 50);
  EXPECT_LE(most_pieces, 2 * ConstraintFit::kMaxConstraints + 1);
  at_the_next.take(told(300));
  field.take(told(300));
  while (field.prepare() || at_the_next.prepare()) {
  }
  EXPECT_EQ(force_N(at_the_next, beyond_m), force_N(field, beyond_m));
}

// What is left is done by the next take() at the latest, and a field that begins anew forgets it.
TEST(UnilateralConstraintField, EndsASearchThatNobodyGoesOnWith) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const auto told = [&](int i) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    return observe(p, object.force_N(p) + plane_N(p, Vector3d::UnitZ(), {0, 0, 0.005}, 1000.0));
  };
  UnilateralConstraintField<double> prepared{FieldSettings{}};
  UnilateralConstraintField<double> taken{FieldSettings{}};
  int i = 0;
  while (i < 300 && !prepared.take(told(i)).unfinished) {
    taken.take(told(i++));
  }
  ASSERT_LT(i, 300);
  EXPECT_TRUE(taken.take(told(i)).unfinished);
  while (prepared.prepare()) {
  }
  take_whole(prepared, told(i + 1));
  take_whole(taken, told(i + 1));
  EXPECT_EQ(taken.constraint_count(), prepared.constraint_count());
  for (const Vector3d& p : {Vector3d(0, 0, 0.001), Vector3d(0.004, 0, 0.01)}) {
    EXPECT_EQ(force_N(taken, p), force_N(prepared, p));
  }

  UnilateralConstraintField<double> anew{FieldSettings{}};
  for (int n = 0; n < i; ++n) {
    anew.take(told(n));
  }
  ASSERT_TRUE(anew.take(told(i)).unfinished);
  std::vector<Observation> recent;
  for (int n = i - 5; n <= i; ++n) {
    recent.push_back(observe(motion.position_m(n * kPeriod_s),
                             object.force_N(motion.position_m(n * kPeriod_s))));
  }
  EXPECT_TRUE(anew.begin_with(recent));
  while (anew.prepare()) {
  }
  EXPECT_TRUE(anew.ready());
  EXPECT_FALSE(anew.knows_walls());
  const Observation& newest = recent.back();
  EXPECT_LT((force_N(anew, newest.position_m) - newest.force_N).norm(),
            0.01 * newest.force_N.norm());
}

// A search that is given up leaves the walls that were known.
TEST(UnilateralConstraintField, KeepsItsWallsWhenItBeginsAnewInASearch) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const auto told = [&](int i, double second_wall_m) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    return observe(p, object.force_N(p) + plane_N(p, Vector3d::UnitZ(), {0, 0, 0.004}, 1000.0) +
                          plane_N(p, Vector3d::UnitX(), {second_wall_m, 0, 0}, 2000.0));
  };
  UnilateralConstraintField<double> searching{FieldSettings{}};
  UnilateralConstraintField<double> twin{FieldSettings{}};
  int i = 0;
  for (; i < 200; ++i) {
    take_whole(searching, told(i, 1.0));
    take_whole(twin, told(i, 1.0));
  }
  ASSERT_EQ(searching.constraint_count(), 1);
  while (i < 600 && !searching.take(told(i, 0.0)).unfinished) {
    take_whole(twin, told(i++, 0.0));
  }
  ASSERT_LT(i, 600);
  for (int piece = 0; piece < 4 && !searching.ready(); ++piece) {
    searching.prepare();
  }
  ASSERT_FALSE(searching.ready());
  std::vector<Observation> recent;
  for (int n = 160; n < 200; ++n) {
    recent.push_back(told(n, 1.0));
  }
  for (UnilateralConstraintField<double>* field : {&searching, &twin}) {
    field->begin_with(recent);
    while (field->prepare()) {
    }
  }
  EXPECT_EQ(searching.constraint_count(), twin.constraint_count());
  for (const Vector3d& p : {Vector3d(0, 0, 0.001), Vector3d(0.004, 0, 0.008)}) {
    EXPECT_EQ(force_N(searching, p), force_N(twin, p));
  }
}

// The ensemble hands over at the very sample that explains a wall, and says why.
TEST(UnilateralConstraint, TakesOverInTheEnsembleAtTheFirstSampleBeyondAWall) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const Vector3d surface_m(0, 0, 0.005);
  EnsembleMethod ensemble(EnsembleMethod::Kind::kKriging, {});
  ensemble.contact_made(1, Vector3d::Zero());
  bool touched = false;
  for (int i = 0; i < 600 && !touched; ++i) {
    const Vector3d p = motion.position_m(i * kPeriod_s);
    const Vector3d wall_N = plane_N(p, Vector3d::UnitZ(), surface_m, 1000.0);
    touched = wall_N.norm() > 0.2 && i > 30;
    if (!touched && wall_N != Vector3d::Zero()) {
      continue;  // the first touch is to be one that counts
    }
    ensemble.observe(i * kPeriod_s, p);
    Sample sample;
    sample.time_s = i * kPeriod_s;
    sample.position_W = p;
    sample.force_W = object.force_N(p) + wall_N;
    ensemble.take_sample(sample);
    ensemble.work(1 << 30);
    const ForceEstimate estimate = ensemble.force(i * kPeriod_s, p);
    EXPECT_EQ(estimate.reason == ChoiceReason::kFoundWall, touched);
    EXPECT_EQ(std::string(ensemble.candidates()[estimate.candidate]) == "walls", touched);
  }
  EXPECT_TRUE(touched);
}

// With the work of a cycle bounded, it does so some cycles later, and counts what it does.
TEST(UnilateralConstraint, IsFoundInTheCyclesAfterThatSample) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  const Vector3d surface_m(0, 0, 0.005);
  constexpr int kCyclesPerSample = 17;
  constexpr double kCycle_s = kPeriod_s / kCyclesPerSample;
  EnsembleMethod ensemble(EnsembleMethod::Kind::kKriging, {});
  ensemble.contact_made(1, Vector3d::Zero());
  bool touched = false;
  int cycles_until_found = -1;
  for (int i = 0; i < 600 && cycles_until_found < 0; ++i) {
    const double time_s = i * kPeriod_s;
    const Vector3d p = motion.position_m(time_s);
    const Vector3d wall_N = plane_N(p, Vector3d::UnitZ(), surface_m, 1000.0);
    if (!touched && wall_N != Vector3d::Zero() && (wall_N.norm() < 0.2 || i < 30)) {
      continue;
    }
    touched = touched || wall_N != Vector3d::Zero();
    Sample sample;
    sample.time_s = time_s;
    sample.position_W = p;
    sample.force_W = object.force_N(p) + wall_N;
    ensemble.observe(time_s, p);
    ensemble.take_sample(sample);
    for (int c = 0; c < kCyclesPerSample && cycles_until_found < 0; ++c) {
      ensemble.work(1000);
      const double now_s = time_s + (c + 1) * kCycle_s;
      ensemble.observe(now_s, motion.position_m(now_s));
      const ForceEstimate estimate = ensemble.force(now_s, p);
      if (estimate.reason == ChoiceReason::kFoundWall) {
        cycles_until_found = c;
      }
    }
    if (touched) {
      break;
    }
  }
  EXPECT_TRUE(touched);
  EXPECT_GT(cycles_until_found, 1);  // within the first sample's cycles
}

// A cut makes every force smaller at once. No wall does that, and the ensemble must not take it for
// one.
TEST(UnilateralConstraint, DoesNotTakeACutForAWall) {
  const AnchoredSprings object(kSeed);
  for (const unsigned seed : {1u, 2u, 3u}) {
    SCOPED_TRACE(seed);
    const HandMotion motion(seed);
    UnilateralConstraintField<double> field{FieldSettings{}};
    int surprises = 0;
    for (int i = 0; i < 300; ++i) {
      const Vector3d p = motion.position_m(i * kPeriod_s);
      const Innovation innovation =
          take_whole(field, observe(p, (i < 150 ? 1.0 : 0.5) * object.force_N(p)));
      surprises += innovation.surprised ? 1 : 0;
      if (i == 150) {
        EXPECT_FALSE(innovation.explained);
        EXPECT_EQ(field.constraint_count(), 0);
      }
    }
    EXPECT_GT(surprises, 0);
  }
}

}  // namespace
}  // namespace forcegrid::kriging
