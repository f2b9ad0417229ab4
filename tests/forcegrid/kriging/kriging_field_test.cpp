// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_field.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <random>
#include <vector>

#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using testing::AnchoredSprings;
using testing::HandMotion;

using Plain = DictionaryField<double, 32, 0>;
using Tangent = DictionaryField<double, 32, 4>;
constexpr unsigned kSeed = 7;
const History kNoHistory = History::Zero();

Observation observe(const Vector3d& position_m, const Vector3d& force_N) {
  Observation o;
  o.position_m = position_m;
  o.force_N = force_N;
  return o;
}

Observation observe_with_stiffness(const Vector3d& position_m, const AnchoredSprings& object) {
  Observation o = observe(position_m, object.force_N(position_m));
  const Matrix3d j = object.stiffness_N_per_m(position_m);
  o.has_stiffness = true;
  for (int i = 0; i < 6; ++i) {
    o.stiffness_N_per_m[i] = j(kStiffnessRow[i], kStiffnessColumn[i]);
  }
  return o;
}

std::vector<Vector3d> scattered(int count, double size_m, unsigned seed = kSeed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-size_m, size_m);
  std::vector<Vector3d> result;
  for (int i = 0; i < count; ++i) {
    result.emplace_back(uniform(random), uniform(random), uniform(random));
  }
  return result;
}

Vector3d force_N(const Field& field, const Vector3d& p) {
  return field.read(p, kNoHistory).force_N;
}

TEST(DictionaryField, KnowsNothingAtFirst) {
  const Plain field{FieldSettings{}};
  EXPECT_EQ(field.sample_count(), 0);
  EXPECT_EQ(force_N(field, Vector3d(0.01, 0.0, 0.0)), Vector3d::Zero());
  EXPECT_GT(field.read(Vector3d::Zero(), kNoHistory).nearest_m2, 1e3);
}

// From three samples within 4 mm, on one line, the field predicts the forces within 10 mm around.
TEST(DictionaryField, LearnsInAFewSamplesThatAnotherContactIsStifferOrSofter) {
  const AnchoredSprings object(kSeed);
  for (const double scale : {0.7, 1.0, 1.3}) {
    const AnchoredSprings elsewhere(kSeed, scale);
    double error[2] = {0.0, 0.0};
    for (const bool with_contact : {false, true}) {
      Plain field{FieldSettings{}};
      for (const Vector3d& p : scattered(30, 0.012)) {
        field.take(observe(p, object.force_N(p)));
      }
      for (const double along_m : {0.001, 0.0025, 0.004}) {
        const Vector3d p = along_m * Vector3d(0.6, 0.0, 0.8);
        Observation o = observe(p, elsewhere.force_N(p));
        o.contact = with_contact ? 1 : 0;
        field.take(o);
      }
      double error_N2 = 0.0;
      double reference_N2 = 0.0;
      for (const Vector3d& p : scattered(40, 0.010, kSeed + 1)) {
        error_N2 += (force_N(field, p) - elsewhere.force_N(p)).squaredNorm();
        reference_N2 += elsewhere.force_N(p).squaredNorm();
      }
      error[with_contact ? 1 : 0] = std::sqrt(error_N2 / reference_N2);
    }
    EXPECT_LT(error[1], 0.02) << "scale " << scale << ", seed " << kSeed;
    if (scale != 1.0) {
      EXPECT_GT(error[0], 3.0 * error[1]) << "scale " << scale << ", seed " << kSeed;
    }
  }
}

// Where the tool grabs, the force shows nothing. The stiffness there shows how stiff the object is
// 10 mm around.
TEST(DictionaryField, LearnsFromTheFirstStiffnessThatAnotherContactIsStifferOrSofter) {
  const AnchoredSprings object(kSeed);
  for (const double scale : {0.7, 1.0, 1.3}) {
    const AnchoredSprings elsewhere(kSeed, scale);
    Tangent field([] {
      FieldSettings settings;
      settings.stiffness_samples = 4;
      return settings;
    }());
    for (const Vector3d& p : scattered(30, 0.012)) {
      field.take(observe_with_stiffness(p, object));
    }
    Observation first = observe_with_stiffness(Vector3d::Zero(), elsewhere);
    first.contact = 1;
    field.take(first);
    double error_N2 = 0.0;
    double size_N2 = 0.0;
    for (const Vector3d& p : scattered(50, 0.010, kSeed + 1)) {
      error_N2 += (force_N(field, p) - elsewhere.force_N(p)).squaredNorm();
      size_N2 += elsewhere.force_N(p).squaredNorm();
    }
    EXPECT_LT(std::sqrt(error_N2 / size_N2), 0.01) << "scale " << scale << ", seed " << kSeed;
  }
}

TEST(DictionaryField, PassesThroughItsSamplesAsTheNuggetGoesToZero) {
  const AnchoredSprings object(kSeed);
  double last_error_N = 1e9;
  for (const double nugget_N2 : {1e-2, 1e-4, 1e-6, 1e-8}) {
    FieldSettings settings;
    settings.nugget_N2 = nugget_N2;
    Plain field(settings);
    double error_N = 0.0;
    for (const Vector3d& p : scattered(20, 0.015)) {
      field.take(observe(p, object.force_N(p)));
    }
    ASSERT_EQ(field.sample_count(), 20);
    for (const Vector3d& p : scattered(20, 0.015)) {
      error_N = std::max(error_N, (force_N(field, p) - object.force_N(p)).norm());
    }
    EXPECT_LT(error_N, last_error_N);
    EXPECT_LT(error_N, 3.0 * std::sqrt(3.0 * nugget_N2));
    last_error_N = error_N;
  }
}

TEST(DictionaryField, ReproducesALinearConservativeFieldAlsoOutsideItsSamples) {
  Matrix3d j;
  j << -300, 40, -10, 40, -500, 70, -10, 70, -900;
  const Vector3d offset(0.4, -0.3, 0.2);
  FieldSettings settings;
  settings.nugget_N2 = 1e-8;
  Plain field(settings);
  for (const Vector3d& p : scattered(12, 0.01)) {
    field.take(observe(p, j * p + offset));
  }
  for (const Vector3d& p : scattered(20, 0.02, kSeed + 1)) {
    EXPECT_LT((force_N(field, p) - (j * p + offset)).norm(), 2e-3 * (j * p + offset).norm() + 1e-3);
  }
}

TEST(DictionaryField, HasNoCurlWhateverItIsTold) {
  Plain field{FieldSettings{}};
  Tangent tangent{[] {
    FieldSettings settings;
    settings.stiffness_samples = 4;
    return settings;
  }()};
  const AnchoredSprings object(kSeed);
  for (const Vector3d& p : scattered(15, 0.01)) {
    // A vortex, which no conservative field can follow.
    field.take(observe(p, Vector3d(-100.0 * p.y(), 100.0 * p.x(), 0.0)));
    tangent.take(observe_with_stiffness(p, object));
  }
  for (const Field* each :
       {static_cast<const Field*>(&field), static_cast<const Field*>(&tangent)}) {
    for (const Vector3d& p : scattered(10, 0.012, kSeed + 1)) {
      Matrix3d j;
      constexpr double kStep_m = 1e-6;
      for (int a = 0; a < 3; ++a) {
        const Vector3d step = kStep_m * Vector3d::Unit(a);
        j.col(a) = (force_N(*each, p + step) - force_N(*each, p - step)) / (2.0 * kStep_m);
      }
      EXPECT_LT((j - j.transpose()).norm(), 1e-5 * j.norm());
    }
  }
}

template <typename FieldType>
void expect_stiffness_as_differences(const FieldType& field, const History& history,
                                     bool history_moves) {
  constexpr double kStep_m = 1e-6;
  for (const Vector3d& p : scattered(10, 0.015, kSeed + 1)) {
    const Matrix3d j = field.stiffness_N_per_m(p, history);
    for (int a = 0; a < 3; ++a) {
      const Vector3d step = kStep_m * Vector3d::Unit(a);
      History ahead = history;
      History behind = history;
      if (history_moves) {
        ahead.colwise() += step;
        behind.colwise() -= step;
      }
      const Vector3d difference =
          (field.read(p + step, ahead).force_N - field.read(p - step, behind).force_N) /
          (2.0 * kStep_m);
      EXPECT_LT((j.col(a) - difference).norm(), 1e-6 * j.norm()) << "seed " << kSeed;
    }
  }
}

TEST(DictionaryField, TellsItsDerivativeWhateverItsKernelAndData) {
  const AnchoredSprings object(kSeed);
  for (const RadialShape shape : {RadialShape::kSquaredExponential, RadialShape::kMatern72}) {
    FieldSettings settings;
    settings.kernel.shape = shape;
    settings.stiffness_samples = 4;
    Tangent field(settings);
    for (const Vector3d& p : scattered(25, 0.015)) {
      field.take(observe_with_stiffness(p, object));
    }
    ASSERT_EQ(field.row_count(), 3 * field.sample_count() + 4 * 6);
    expect_stiffness_as_differences(field, kNoHistory, false);
  }
  FieldSettings settings;
  settings.kernel.history_gain = 1.0;
  DictionaryField<double, 48, 0> remembering(settings);
  History history;
  for (const Vector3d& p : scattered(25, 0.015)) {
    Observation o = observe(p, object.force_N(p));
    o.history << p, 2.0 * p, -p;
    o.history *= 0.1;
    remembering.take(o);
    history = o.history;
  }
  expect_stiffness_as_differences(remembering, history, true);
}

TEST(DictionaryField, DoesNoWorkAroundAClosedLoop) {
  const AnchoredSprings object(kSeed);
  Plain field{FieldSettings{}};
  for (const Vector3d& p : scattered(32, 0.012)) {
    field.take(observe(p, object.force_N(p)));
  }
  double work_J = 0.0;
  double stored_J = 0.0;
  constexpr int kSteps = 2000;
  Vector3d before(0.008, 0.0, 0.0);
  for (int i = 1; i <= kSteps; ++i) {
    const double phase = 2.0 * std::numbers::pi * i / kSteps;
    const Vector3d p =
        0.008 * Vector3d(std::cos(phase), std::sin(phase) * 0.8, std::sin(phase) * 0.6);
    work_J += force_N(field, 0.5 * (p + before)).dot(p - before);
    stored_J = std::max(stored_J, 0.5 * object.force_N(p).norm() * p.norm());
    before = p;
  }
  EXPECT_LT(std::abs(work_J), 1e-4 * stored_J);  // the midpoint rule's own error
}

// After hundreds of samples, with rows coming and going, the field must be what a dense solve over
// its final dictionary gives. All positions are kept, so the dictionary is known.
TEST(DictionaryField, EqualsADenseSolveOverItsDictionary) {
  const AnchoredSprings object(kSeed);
  FieldSettings settings;
  settings.samples = 12;
  settings.surprise = 1e300;
  settings.spacing.metres = 1e-9;  // keep everything, evict what the rule says
  settings.spacing.newtons = 1e3;
  Plain field(settings);
  std::vector<Vector3d> kept;
  for (const Vector3d& p : scattered(300, 0.02)) {
    while (kept.size() >= 12) {
      std::size_t worst = 0;
      double least = 1e300;
      for (std::size_t i = 0; i < kept.size(); ++i) {
        double nearest_m2 = 1e300;
        for (std::size_t j = 0; j < kept.size(); ++j) {
          if (i != j) {
            nearest_m2 = std::min(nearest_m2, (kept[i] - kept[j]).squaredNorm());
          }
        }
        const double value = nearest_m2 / ((kept[i] - p).squaredNorm() + 1e-4);
        if (value < least) {
          least = value;
          worst = i;
        }
      }
      kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(worst));
    }
    kept.push_back(p);
    field.take(observe(p, object.force_N(p)));
  }
  const int n = static_cast<int>(kept.size());
  ASSERT_EQ(field.sample_count(), n);
  Eigen::MatrixXd k(3 * n, 3 * n);
  Eigen::VectorXd f(3 * n);
  for (int i = 0; i < n; ++i) {
    f.segment<3>(3 * i) = object.force_N(kept[static_cast<std::size_t>(i)]);
    for (int j = 0; j < n; ++j) {
      k.block<3, 3>(3 * i, 3 * j) =
          settings.kernel.force_force(kept[static_cast<std::size_t>(i)], kNoHistory,
                                      kept[static_cast<std::size_t>(j)], kNoHistory);
    }
  }
  k.diagonal().array() += settings.nugget_N2;
  const Eigen::LLT<Eigen::MatrixXd> dense(k);
  const Eigen::VectorXd alpha = dense.solve(f);
  const double scale = std::max(1.0, f.dot(alpha) / (3 * n));
  for (const Vector3d& p : scattered(20, 0.02, kSeed + 1)) {
    Eigen::MatrixXd cross(3, 3 * n);
    for (int i = 0; i < n; ++i) {
      cross.block<3, 3>(0, 3 * i) =
          settings.kernel.force_force(p, kNoHistory, kept[static_cast<std::size_t>(i)], kNoHistory);
    }
    EXPECT_LT((force_N(field, p) - cross * alpha).norm(), 1e-6);
    const Matrix3d covariance = settings.kernel.force_force(p, kNoHistory, p, kNoHistory) -
                                cross * dense.solve(cross.transpose());
    EXPECT_NEAR(field.deviation_N(p, kNoHistory), std::sqrt(scale * covariance.trace() / 3.0),
                1e-4 * field.deviation_N(p, kNoHistory) + 1e-6);
  }
}

// Fields drawn from the prior itself: errors have to be as large as the deviation says.
TEST(DictionaryField, TellsItsErrorInTheMeanOverFieldsFromItsPrior) {
  RecordProperty("seed", static_cast<int>(kSeed));
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal;
  const std::vector<Vector3d> at = scattered(12, 0.02);
  const std::vector<Vector3d> probe = scattered(6, 0.03, kSeed + 1);
  std::vector<Vector3d> all = at;
  all.insert(all.end(), probe.begin(), probe.end());
  const FieldSettings settings;
  const int n = static_cast<int>(all.size());
  Eigen::MatrixXd k(3 * n, 3 * n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      k.block<3, 3>(3 * i, 3 * j) =
          settings.kernel.force_force(all[static_cast<std::size_t>(i)], kNoHistory,
                                      all[static_cast<std::size_t>(j)], kNoHistory);
    }
  }
  k.diagonal().array() += 1e-9;
  const Eigen::MatrixXd root = k.llt().matrixL();
  double normalised = 0.0;
  int count = 0;
  for (int draw = 0; draw < 60; ++draw) {
    Eigen::VectorXd white(3 * n);
    for (double& w : white) {
      w = normal(random);
    }
    const Eigen::VectorXd f = root * white;
    Plain field(settings);
    for (int i = 0; i < static_cast<int>(at.size()); ++i) {
      field.take(observe(at[static_cast<std::size_t>(i)], f.segment<3>(3 * i)));
    }
    for (int i = static_cast<int>(at.size()); i < n; ++i) {
      const Vector3d& p = all[static_cast<std::size_t>(i)];
      const double deviation_N = field.deviation_N(p, kNoHistory);
      normalised += (force_N(field, p) - f.segment<3>(3 * i)).squaredNorm() / 3.0 /
                    (deviation_N * deviation_N);
      ++count;
    }
  }
  // 360 probes: one within 20 % by chance alone; the data's own scale can only enlarge the claim.
  EXPECT_GT(std::sqrt(normalised / count), 0.7);
  EXPECT_LT(std::sqrt(normalised / count), 1.2);
}

// Against the density of the third force given two, from the kernel's matrix of all three.
TEST(DictionaryField, SaysHowLikelyASampleWas) {
  const std::vector<Vector3d> at = {{0, 0, 0.002}, {0.004, -0.002, 0.005}, {0.003, 0.002, 0.007}};
  const std::vector<Vector3d> forces_N = {{0.02, 0, -0.3}, {-0.4, 0.1, -0.6}, {-0.2, -0.3, -0.9}};
  const FieldSettings settings;
  Eigen::Matrix<double, 9, 9> k;
  Eigen::Matrix<double, 9, 1> f;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      k.block<3, 3>(3 * i, 3 * j) = settings.kernel.force_force(
          at[static_cast<std::size_t>(i)], kNoHistory, at[static_cast<std::size_t>(j)], kNoHistory);
    }
    f.segment<3>(3 * i) = forces_N[static_cast<std::size_t>(i)];
  }
  k.diagonal().array() += settings.nugget_N2;
  // ln p(f3 | f1, f2) = ln p(f1, f2, f3) - ln p(f1, f2)
  const auto nats = [&](int rows) {
    const Eigen::MatrixXd part = k.topLeftCorner(rows, rows);
    const Eigen::VectorXd data = f.head(rows);
    return -0.5 * (data.dot(part.llt().solve(data)) + std::log(part.determinant()));
  };
  Plain field(settings);
  EXPECT_EQ(field.take(observe(at[0], forces_N[0])).likelihood_nats, 0.0) << "nothing was known";
  EXPECT_NEAR(field.take(observe(at[1], forces_N[1])).likelihood_nats, nats(6) - nats(3), 1e-6);
  EXPECT_NEAR(field.take(observe(at[2], forces_N[2])).likelihood_nats, nats(9) - nats(6), 1e-6);
}

TEST(DictionaryField, IsAsGoodInSinglePrecision) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  for (const double nugget_N2 : {1e-5, 1e-6}) {
    FieldSettings settings;
    settings.nugget_N2 = nugget_N2;
    Plain exact(settings);
    DictionaryField<float, 32, 0> single(settings);
    for (int i = 0; i < 200; ++i) {
      const Vector3d p = motion.position_m(i / 30.0);
      exact.take(observe(p, object.force_N(p)));
      single.take(observe(p, object.force_N(p)));
      const Vector3d q = motion.position_m((i + 1.5) / 30.0);
      EXPECT_LT((force_N(exact, q) - force_N(single, q)).norm(), 2e-3);  // of some 5 N
    }
  }
}

// The sheet's first pitfall: a rule that replaces the nearest sample within a full spacing drags
// one sample along a slow motion, and the field forgets where it came from.
TEST(DictionaryField, RemembersAlongASlowMotion) {
  const AnchoredSprings object(kSeed, 0.15);  // soft: only the distance counts
  Plain field{FieldSettings{}};
  for (int i = 0; i <= 100; ++i) {
    const Vector3d p(0.0, 0.0, 0.0002 * i);
    field.take(observe(p, object.force_N(p)));
  }
  EXPECT_GE(field.sample_count(), 8);
  for (const double z_m : {0.0, 0.005, 0.010, 0.015, 0.020}) {
    const Vector3d p(0.0, 0.0, z_m);
    EXPECT_LT((force_N(field, p) - object.force_N(p)).norm(),
              0.005 * object.force_N(Vector3d(0, 0, 0.02)).norm());
  }
}

TEST(DictionaryField, ReadsTheSameIfItHasPutOffItsWeights) {
  const AnchoredSprings object(kSeed);
  Plain always{FieldSettings{}};
  Plain later{FieldSettings{}};
  later.expect_reads(false);
  for (const Vector3d& p : scattered(40, 0.02)) {
    const Observation o = observe(p, object.force_N(p));
    EXPECT_EQ(later.take(o).error_N, always.take(o).error_N);
  }
  for (const bool again : {false, true}) {
    later.expect_reads(true);
    for (const Vector3d& p : scattered(5, 0.02, kSeed + 1)) {
      EXPECT_GT(force_N(always, p).norm(), 0.0);
      EXPECT_EQ(force_N(later, p), force_N(always, p)) << "again: " << again;
    }
    const Observation o = observe(Vector3d(0.005, 0.0, 0.0), Vector3d(-1.0, 0.0, 0.0));
    always.take(o);
    later.take(o);
  }
}

// A stiff object in a light hand: all motion is within a fifth of the spacing, so only the force
// distinguishes samples.
TEST(DictionaryField, LearnsTheStiffnessOfAStiffObjectWithinAFifthOfAMillimetre) {
  const Matrix3d j = Vector3d(-2000.0, -3000.0, -4000.0).asDiagonal();
  for (const double spacing_N : {0.1, 1e6}) {
    FieldSettings settings;
    settings.spacing.newtons = spacing_N;
    Plain field(settings);
    const auto path = scattered(200, 1e-4);
    for (const Vector3d& p : path) {
      field.take(observe(p, j * p));
    }
    constexpr double kStep_m = 1e-5;
    const Vector3d slope =
        (force_N(field, Vector3d(0, 0, kStep_m)) - force_N(field, Vector3d(0, 0, -kStep_m))) /
        (2.0 * kStep_m);
    const double error = (slope - j.col(2)).norm() / 4000.0;
    if (spacing_N < 1.0) {
      EXPECT_LT(error, 0.05);
      EXPECT_GT(field.sample_count(), 8);
    } else {
      EXPECT_LT(field.sample_count(), 4) << "without the force nothing is kept";
    }
  }
}

TEST(DictionaryField, ForgetsACutAfterASurprise) {
  const AnchoredSprings before(kSeed);
  const AnchoredSprings after(kSeed, 0.5);
  const HandMotion motion(kSeed);
  for (const double surprise : {25.0, 1e300}) {
    FieldSettings settings;
    settings.surprise = surprise;
    Plain field(settings);
    bool surprised_before = false;
    bool surprised_after = false;
    double squares_N2 = 0.0;
    double reference_N2 = 0.0;
    for (int i = 0; i < 300; ++i) {
      const Vector3d p = motion.position_m(i / 30.0);
      const Vector3d reference_N = (i < 150 ? before : after).force_N(p);
      if (i >= 180) {
        squares_N2 += (force_N(field, p) - reference_N).squaredNorm();
        reference_N2 += reference_N.squaredNorm();
      }
      const Innovation innovation = field.take(observe(p, reference_N));
      (i < 150 ? surprised_before : surprised_after) |= innovation.surprised;
    }
    EXPECT_FALSE(surprised_before);
    const double error = std::sqrt(squares_N2 / reference_N2);
    if (surprise < 1e9) {
      EXPECT_TRUE(surprised_after);
      EXPECT_LT(error, 0.03);
    } else {
      EXPECT_GT(error, 0.03) << "the old samples would stay for long";
    }
  }
}

// An answer from beyond a surface that the tool has not met yet: it contradicts the path, but where
// the tool is the path knows better.
TEST(DictionaryField, DoubtsAnAnswerRatherThanThePathThatItContradicts) {
  const Matrix3d j = -200.0 * Matrix3d::Identity();
  const auto error_N = [&](bool from_query) {
    Plain field{FieldSettings{}};
    Vector3d tool_m = Vector3d::Zero();
    for (int i = 0; i < 20; ++i) {
      tool_m = Vector3d(0.5e-3 * i, 2e-3 * std::sin(0.5 * i), 0.0);
      field.take(observe(tool_m, j * tool_m));
    }
    const Vector3d beside_m = tool_m + Vector3d(0.0, 6e-3, 0.0);
    Observation o = observe(beside_m, j * beside_m + Vector3d(0.0, -3.0, 0.0));
    o.from_query = from_query;
    EXPECT_TRUE(field.take(o).surprised);
    return (force_N(field, tool_m) - j * tool_m).norm();
  };
  EXPECT_LT(error_N(true), 0.005);
  EXPECT_GT(error_N(false), 0.05) << "a sample of the path would say that the object has changed";
}

TEST(DictionaryField, IsNotSurprisedByAStiffObject) {
  const Matrix3d j = -3000.0 * Matrix3d::Identity();
  Plain field{FieldSettings{}};
  for (const Vector3d& p : scattered(100, 0.002)) {
    EXPECT_FALSE(field.take(observe(p, j * p)).surprised);
  }
}

TEST(DictionaryField, KeepsWithinItsCapacity) {
  const AnchoredSprings object(kSeed);
  FieldSettings settings;
  settings.samples = 16;
  Plain field(settings);
  for (const Vector3d& p : scattered(200, 0.03)) {
    field.take(observe(p, object.force_N(p)));
    EXPECT_LE(field.sample_count(), 16);
    EXPECT_EQ(field.row_count(), 3 * field.sample_count());
  }
}

TEST(DictionaryField, KeepsTheStiffnessOfTheFourNewestSamplesThatHaveIt) {
  const AnchoredSprings object(kSeed);
  FieldSettings settings;
  settings.stiffness_samples = 4;
  Tangent field(settings);
  int i = 0;
  for (const Vector3d& p : scattered(60, 0.02)) {
    Observation o = observe_with_stiffness(p, object);
    o.has_stiffness = i % 3 != 0;
    field.take(o);
    ++i;
    EXPECT_LE(field.row_count(), 3 * field.sample_count() + 24);
  }
  EXPECT_EQ(field.row_count(), 3 * 32 + 24);
}

TEST(DictionaryField, KnowsTheSurroundingsOfOneSampleWithStiffness) {
  const AnchoredSprings object(kSeed);
  FieldSettings settings;
  settings.stiffness_samples = 4;
  Tangent with(settings);
  Plain without{FieldSettings{}};
  const Vector3d at(0.004, 0.002, 0.006);
  with.take(observe_with_stiffness(at, object));
  without.take(observe(at, object.force_N(at)));
  for (const Vector3d& d : scattered(10, 0.003)) {
    const Vector3d reference_N = object.force_N(at + d);
    const double moved_N = (reference_N - object.force_N(at)).norm();
    EXPECT_LT((force_N(with, at + d) - reference_N).norm(), 0.1 * moved_N);
    EXPECT_LT((force_N(with, at + d) - reference_N).norm(),
              (force_N(without, at + d) - reference_N).norm());
    EXPECT_LT(with.deviation_N(at + d, kNoHistory), 0.1 * without.deviation_N(at + d, kNoHistory));
  }
}

TEST(DictionaryField, TakesAnswersToQueriesWhereItKnowsNothingAndKeepsItsNewestSample) {
  const AnchoredSprings object(kSeed);
  Plain field{FieldSettings{}};
  field.take(observe(Vector3d::Zero(), Vector3d::Zero()));
  Observation answer = observe(Vector3d(0.01, 0, 0), object.force_N(Vector3d(0.01, 0, 0)));
  answer.from_query = true;
  field.take(answer);
  EXPECT_EQ(field.sample_count(), 2);
  answer.position_m.x() += 0.0001;
  field.take(answer);
  EXPECT_EQ(field.sample_count(), 2) << "within a spacing of what is known";
  EXPECT_NEAR(force_N(field, Vector3d(0.01, 0, 0)).x(), object.force_N(Vector3d(0.01, 0, 0)).x(),
              1e-3);
}

// Force on a velocity as well as on position: only history features can distinguish them.
TEST(DictionaryField, LearnsADamperFromHistoryFeatures) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  constexpr double kDamping_Ns_per_m = 3.0;
  constexpr double kTau_s = 0.005;
  double error[2] = {0.0, 0.0};
  for (int with = 0; with < 2; ++with) {
    FieldSettings settings;
    settings.kernel.history_gain = with == 1 ? 1.0 : 0.0;
    settings.samples = 48;
    DictionaryField<double, 48, 0> field(settings);
    double squares_N2 = 0.0;
    double reference_N2 = 0.0;
    for (int i = 0; i < 450; ++i) {
      const double t_s = i / 30.0;
      const Vector3d p = motion.position_m(t_s);
      const Vector3d v = (motion.position_m(t_s + 1e-4) - motion.position_m(t_s - 1e-4)) / 2e-4;
      History h = History::Zero();
      h.col(0) = kTau_s * v;
      h.col(1) = 6.0 * kTau_s * v;
      const Vector3d reference_N = object.force_N(p) - kDamping_Ns_per_m * v;
      if (i > 150) {
        squares_N2 += (field.read(p, h).force_N - reference_N).squaredNorm();
        reference_N2 += reference_N.squaredNorm();
      }
      Observation o = observe(p, reference_N);
      o.history = h;
      field.take(o);
    }
    error[with] = std::sqrt(squares_N2 / reference_N2);
  }
  EXPECT_GT(error[0], 0.012);
  EXPECT_LT(error[1], 0.01);
  EXPECT_LT(error[1], 0.2 * error[0]);
}

// The rows of a sample's stiffness move with its place: with rows of two places the factor is no
// covariance's, and grows until it overflows.
TEST(DictionaryField, AveragesSamplesWithStiffnessAndStaysFinite) {
  constexpr double kNoise_N = 0.03;
  SCOPED_TRACE(kSeed);
  FieldSettings settings;
  settings.nugget_N2 = 1e-3;
  settings.samples = 32;
  settings.stiffness_samples = 2;
  settings.averaged = 8;
  settings.averaged_spacing.newtons = 12.0 * std::sqrt(settings.nugget_N2);
  DictionaryField<float, 32, 4> field(settings);
  std::mt19937 random(kSeed);
  std::normal_distribution<double> noise_N(0.0, kNoise_N);
  std::normal_distribution<double> tremor_m(0.0, 1e-3);
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p(0.006 * std::sin(0.05 * i) + tremor_m(random),
                     0.006 * std::sin(0.037 * i) + tremor_m(random), tremor_m(random));
    const Vector3d true_N = -200.0 * p;
    Observation o =
        observe(p, true_N + Vector3d(noise_N(random), noise_N(random), noise_N(random)));
    o.has_stiffness = true;
    for (int k = 0; k < 6; ++k) {
      o.stiffness_N_per_m[k] = kStiffnessRow[k] == kStiffnessColumn[k] ? -200.0 : 0.0;
    }
    field.take(o);
    ASSERT_LT((field.read(p, History::Zero()).force_N - true_N).norm(), 0.3) << i;
  }
}

TEST(DictionaryField, AveragesTheNoiseOfARestingTool) {
  // A full dictionary, and noise of one size and either sign at one place. Of an average over 8
  // that alternates, a fifteenth of it remains; the newest sample, one in nine, adds a ninth.
  constexpr double kNoise_N = 0.03;
  double largest_N[2] = {};
  for (const bool averages : {false, true}) {
    FieldSettings settings;
    settings.nugget_N2 = kNoise_N * kNoise_N;
    settings.samples = 5;
    settings.averaged = averages ? 8 : 1;
    settings.averaged_spacing.newtons = 12.0 * kNoise_N;
    Plain field(settings);
    const double stiffness_N_per_m = 200.0;
    for (const Vector3d& p : {Vector3d(0.02, 0.0, 0.0), Vector3d(0.0, 0.02, 0.0),
                              Vector3d(0.0, 0.0, 0.02), Vector3d(-0.02, 0.0, 0.0)}) {
      field.take(observe(p, -stiffness_N_per_m * p));
    }
    const Vector3d rest_m(0.004, 0.004, 0.004);
    const Vector3d true_N = -stiffness_N_per_m * rest_m;
    for (int i = 0; i < 60; ++i) {
      const double sign = i % 2 == 0 ? 1.0 : -1.0;
      field.take(observe(rest_m, true_N + sign * kNoise_N * Vector3d::UnitX()));
      if (i >= 30) {
        const double error_N = (force_N(field, rest_m) - true_N).norm();
        largest_N[averages ? 1 : 0] = std::max(largest_N[averages ? 1 : 0], error_N);
      }
    }
    EXPECT_EQ(field.sample_count(), 5);
  }
  EXPECT_LT(largest_N[1], (1.0 / 9.0 + 1.0 / 15.0) * kNoise_N);
  EXPECT_GT(largest_N[0], 0.4 * kNoise_N);
}

}  // namespace
}  // namespace forcegrid::kriging
