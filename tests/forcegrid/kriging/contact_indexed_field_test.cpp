// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/contact_indexed_field.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::AnchoredSprings;

constexpr unsigned kSeed = 5;
const History kNoHistory = History::Zero();

class Scatter {
 public:
  explicit Scatter(unsigned seed) : random_(seed) {}
  Vector3d within(double size_m) {
    std::uniform_real_distribution<double> uniform(-size_m, size_m);
    return {uniform(random_), uniform(random_), uniform(random_)};
  }
  Vector3d place() {
    const Vector3d p = within(0.03);
    return {p.x(), p.y(), 0.0};
  }

 private:
  std::mt19937 random_;
};

struct At {
  Vector3d d, c;
};

std::vector<At> scattered(int count, unsigned seed) {
  Scatter scatter(seed);
  std::vector<At> all;
  for (int i = 0; i < count; ++i) {
    all.push_back({scatter.within(0.02), scatter.place()});
  }
  return all;
}

Matrix3d covariance(const ContactKernel& kernel, const At& a, const At& b) {
  return kernel.similarity(a.c, b.c) *
         kernel.force_force(a.d, kernel.with_origin(a.d), b.d, kernel.with_origin(b.d));
}

MatrixXd covariances(const ContactKernel& kernel, const std::vector<At>& a,
                     const std::vector<At>& b) {
  MatrixXd k(3 * a.size(), 3 * b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < b.size(); ++j) {
      k.block<3, 3>(3 * static_cast<Eigen::Index>(i), 3 * static_cast<Eigen::Index>(j)) =
          covariance(kernel, a[i], b[j]);
    }
  }
  return k;
}

// The zero at every contact point, by conditioning the product of the covariances without it.
TEST(ContactKernel, IsWhatIsLeftOnceTheForceAtEveryContactPointIsKnownToBeZero) {
  const ContactKernel kernel;
  const std::vector<At> at = scattered(6, kSeed);
  std::vector<At> zeros;
  for (const At& each : at) {
    zeros.push_back({Vector3d::Zero(), each.c});
  }
  const auto unconditioned = [&kernel](const std::vector<At>& a, const std::vector<At>& b) {
    MatrixXd k(3 * a.size(), 3 * b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (std::size_t j = 0; j < b.size(); ++j) {
        k.block<3, 3>(3 * static_cast<Eigen::Index>(i), 3 * static_cast<Eigen::Index>(j)) =
            kernel.similarity(a[i].c, b[j].c) *
            kernel.field.force_force(a[i].d, kNoHistory, b[j].d, kNoHistory);
      }
    }
    return k;
  };
  const MatrixXd cross = unconditioned(at, zeros);
  const MatrixXd left =
      unconditioned(at, at) - cross * unconditioned(zeros, zeros).ldlt().solve(cross.transpose());
  EXPECT_LT((covariances(kernel, at, at) - left).norm(), 1e-9 * left.norm());
}

TEST(ContactKernel, MakesPositiveDefiniteMatrices) {
  RecordProperty("seed", static_cast<int>(kSeed));
  for (unsigned trial = 0; trial < 5; ++trial) {
    const std::vector<At> at = scattered(20, kSeed + trial);
    const MatrixXd k = covariances(ContactKernel{}, at, at);
    EXPECT_LT((k - k.transpose()).norm(), 1e-12 * k.norm());
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(k);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-13 * eigen.eigenvalues().maxCoeff());
  }
}

TEST(ContactKernel, HasNoCurl) {
  constexpr double kStep_m = 1e-6;
  const ContactKernel kernel;
  const std::vector<At> at = scattered(20, kSeed);
  for (std::size_t i = 1; i < at.size(); ++i) {
    std::array<Matrix3d, 3> slope;
    for (int c = 0; c < 3; ++c) {
      const Vector3d step = kStep_m * Vector3d::Unit(c);
      slope[static_cast<std::size_t>(c)] = (covariance(kernel, {at[i].d + step, at[i].c}, at[0]) -
                                            covariance(kernel, {at[i].d - step, at[i].c}, at[0])) /
                                           (2.0 * kStep_m);
    }
    const double scale = slope[0].norm() + slope[1].norm() + slope[2].norm();
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t a = 0; a < 3; ++a) {
        EXPECT_LT((slope[c].row(static_cast<int>(a)) - slope[a].row(static_cast<int>(c))).norm(),
                  1e-7 * scale);  // rounding of the difference quotients
      }
    }
  }
}

TEST(ContactKernel, GivesTheMeanDiagonalOfItsOwnMatrixAsPriorVariance) {
  const ContactKernel kernel;
  for (const At& at : scattered(10, kSeed)) {
    const double mean_N2 = covariance(kernel, at, at).trace() / 3.0;
    EXPECT_NEAR(kernel.prior_variance_N2(at.d), mean_N2, 1e-12 * mean_N2);
  }
}

// Stiffness that changes by up to 30 % and a direction that turns by up to 0.5 rad over the
// surface.
struct VariedSprings {
  AnchoredSprings springs{kSeed};
  Vector3d force_N(const At& at) const {
    const double angle_rad = 0.5 * std::sin(at.c.y() / 0.02);
    const Eigen::AngleAxisd turn(angle_rad, Vector3d::UnitZ());
    return (1.0 + 0.3 * std::sin(at.c.x() / 0.02)) *
           (turn * springs.force_N(turn.inverse() * at.d));
  }
};

Observation observe(std::uint64_t contact, const At& at, const Vector3d& force_N) {
  Observation o;
  o.contact = contact;
  o.origin_W = at.c;
  o.position_m = at.d;
  o.force_N = force_N;
  return o;
}

void enter(ContactIndexedField& field, std::uint64_t contact, const Vector3d& point_W) {
  field.enter_contact(contact, point_W);
  while (field.prepare()) {
  }
}

void take(ContactIndexedField& field, const Observation& o) {
  field.take(o);
  while (field.prepare()) {
  }
}

Vector3d force_N(const ContactIndexedField& field, const Vector3d& d) {
  return field.read(d, kNoHistory).force_N;
}

std::unique_ptr<ContactIndexedField> field_of(const FieldSettings& settings) {
  return std::make_unique<ContactIndexedField>(settings);
}
std::unique_ptr<ContactIndexedField> plain_field() {
  FieldSettings settings;
  settings.samples = ContactIndexedField::kMaxSamples;
  return field_of(settings);
}
FieldSettings keeping_everything() {
  FieldSettings settings;
  settings.samples = ContactIndexedField::kMaxSamples;
  settings.spacing.metres = 1e-9;
  settings.spacing.newtons = 1e3;
  settings.surprise = 1e300;
  return settings;
}

// Three contacts of twelve samples, read at a fourth: all of them are in the working set, whatever
// order they were chosen in.
TEST(ContactIndexedField, EqualsADenseSolveOverItsWorkingSet) {
  RecordProperty("seed", static_cast<int>(kSeed));
  const VariedSprings object;
  const FieldSettings settings = keeping_everything();
  const auto field = field_of(settings);
  Scatter scatter(kSeed);
  std::vector<At> known;
  std::uint64_t contact = 0;
  Vector3d here_W;
  for (int place = 0; place < 4; ++place) {
    here_W = scatter.place();
    enter(*field, ++contact, here_W);
    for (int i = 0; i < (place < 3 ? 12 : 5); ++i) {
      known.push_back({scatter.within(0.015), here_W});
      take(*field, observe(contact, known.back(), object.force_N(known.back())));
    }
  }
  ASSERT_EQ(field->sample_count(), static_cast<int>(known.size()));
  MatrixXd k = covariances(field->kernel(), known, known);
  k.diagonal().array() += settings.nugget_N2;
  VectorXd f(3 * known.size());
  for (std::size_t i = 0; i < known.size(); ++i) {
    f.segment<3>(3 * static_cast<Eigen::Index>(i)) = object.force_N(known[i]);
  }
  const Eigen::LLT<MatrixXd> dense(k);
  const VectorXd alpha = dense.solve(f);
  const double scale = std::max(1.0, f.dot(alpha) / static_cast<double>(f.size()));
  const double largest_N = f.cwiseAbs().maxCoeff();
  for (int i = 0; i < 20; ++i) {
    const At probe{scatter.within(0.015), here_W};
    const MatrixXd cross = covariances(field->kernel(), {probe}, known);
    // Read in single precision.
    EXPECT_LT((force_N(*field, probe.d) - cross * alpha).norm(), 2e-4 * largest_N);
    const Matrix3d v =
        covariance(field->kernel(), probe, probe) - cross * dense.solve(cross.transpose());
    const double deviation_N = std::sqrt(scale * v.trace() / 3.0);
    EXPECT_NEAR(field->deviation_N(probe.d, kNoHistory), deviation_N, 1e-3 * deviation_N + 1e-6);
  }
}

TEST(ContactIndexedField, IsZeroAtEveryContactPointAndHasNoCurlAroundIt) {
  const VariedSprings object;
  const auto field = plain_field();
  Scatter scatter(kSeed);
  for (std::uint64_t contact = 1; contact <= 6; ++contact) {
    const Vector3d here_W = scatter.place();
    enter(*field, contact, here_W);
    EXPECT_LT(force_N(*field, Vector3d::Zero()).norm(), 1e-3);  // single precision of some newtons
    for (int i = 0; i < 20; ++i) {
      const At at{scatter.within(0.015), here_W};
      take(*field, observe(contact, at, object.force_N(at)));
    }
    EXPECT_LT(force_N(*field, Vector3d::Zero()).norm(), 1e-3);
    EXPECT_FALSE(field->has_offset());
  }
  constexpr double kStep_m = 1e-3;  // single precision leaves no finer one
  for (int i = 0; i < 10; ++i) {
    const Vector3d d = scatter.within(0.01);
    Matrix3d j;
    for (int c = 0; c < 3; ++c) {
      const Vector3d step = kStep_m * Vector3d::Unit(c);
      j.col(c) = (force_N(*field, d + step) - force_N(*field, d - step)) / (2.0 * kStep_m);
    }
    EXPECT_LT((j - j.transpose()).norm(), 2e-3 * j.norm());
    EXPECT_LT((field->stiffness_N_per_m(d, kNoHistory) - j).norm(), 2e-3 * j.norm());
  }
}

// Nine contacts on a grid of 15 mm; then the first of them again, half a millimetre beside,
// where the object differs by 1 %.
TEST(ContactIndexedField, KnowsAPlaceAgainBeforeTheFirstSample) {
  const VariedSprings object;
  const auto field = plain_field();
  Scatter scatter(kSeed);
  std::uint64_t contact = 0;
  double unknown = 0.0;  // worst error at a new place whose neighbour is known
  const auto error_at = [&](const Vector3d& here_W) {
    double squares_N2 = 0.0;
    double reference_N2 = 0.0;
    for (int i = 0; i < 30; ++i) {
      const At at{scatter.within(0.01), here_W};
      squares_N2 += (force_N(*field, at.d) - object.force_N(at)).squaredNorm();
      reference_N2 += object.force_N(at).squaredNorm();
    }
    return std::sqrt(squares_N2 / reference_N2);
  };
  for (int place = 0; place < 9; ++place) {
    const Vector3d here_W(0.015 * (place % 3), 0.015 * (place / 3), 0.0);
    enter(*field, ++contact, here_W);
    if (place > 0) {
      unknown = std::max(unknown, error_at(here_W));
    }
    for (int i = 0; i < 30; ++i) {
      const At at{scatter.within(0.012), here_W};
      take(*field, observe(contact, at, object.force_N(at)));
    }
  }
  EXPECT_GT(unknown, 0.05);  // the places do differ
  const Vector3d again_W(0.0005, 0.0, 0.0);
  enter(*field, ++contact, again_W);
  EXPECT_LT(error_at(again_W), 0.015);
}

TEST(ContactIndexedField, ReadsForTheNewPointAtOnceAndPreparesInSmallPieces) {
  const VariedSprings object;
  const auto field = plain_field();
  Scatter scatter(kSeed);
  for (std::uint64_t contact = 1; contact <= 4; ++contact) {
    const Vector3d here_W(0.01 * static_cast<double>(contact), 0.0, 0.0);
    enter(*field, contact, here_W);
    for (int i = 0; i < 30; ++i) {
      const At at{scatter.within(0.012), here_W};
      take(*field, observe(contact, at, object.force_N(at)));
    }
  }
  const Vector3d d(0.004, -0.003, 0.006);
  const Vector3d here_W(0.04, 0.0, 0.0);
  const Vector3d before_N = force_N(*field, d);
  field->enter_contact(5, here_W);  // the same place
  EXPECT_FALSE(field->ready());
  EXPECT_LT((force_N(*field, d) - before_N).norm(), 1e-4);
  int pieces = 0;
  int rows = 0;
  while (field->prepare()) {
    EXPECT_LE(field->row_count() - rows, 3 * 8);
    rows = field->row_count();
    if (!field->ready()) {
      EXPECT_LT((force_N(*field, d) - before_N).norm(), 1e-4) << "half a factor must not be read";
    }
    ++pieces;
  }
  EXPECT_TRUE(field->ready());
  EXPECT_EQ(field->row_count(), 3 * ContactIndexedField::kMaxSamples);
  EXPECT_EQ(pieces, 1 + 6);
  const Vector3d reference_N = object.force_N({d, here_W});
  EXPECT_LT((force_N(*field, d) - reference_N).norm(), 0.01 * reference_N.norm());
}

// A contact that begins under load: the force at its point is not zero.
TEST(ContactIndexedField, GivesUpTheZeroOfAContactThatContradictsItAndOnlyThere) {
  const VariedSprings object;
  const Vector3d load_N(0.6, -0.3, 0.8);
  const auto field = plain_field();
  Scatter scatter(kSeed);
  std::uint64_t contact = 0;
  for (int place = 0; place < 5; ++place) {
    const Vector3d here_W(0.01 * place, 0.0, 0.0);
    const bool loaded = place == 3;
    enter(*field, ++contact, here_W);
    for (int i = 0; i < 25; ++i) {
      const At at{i == 0 ? Vector3d(0.0005, 0.0, 0.0) : scatter.within(0.012), here_W};
      take(*field, observe(contact, at,
                           object.force_N(at) + (loaded ? load_N : Vector3d(Vector3d::Zero()))));
    }
    EXPECT_EQ(field->has_offset(), loaded) << place;
    for (int i = 0; i < 10; ++i) {
      const At at{scatter.within(0.01), here_W};
      const Vector3d reference_N =
          object.force_N(at) + (loaded ? load_N : Vector3d(Vector3d::Zero()));
      EXPECT_LT((force_N(*field, at.d) - reference_N).norm(), 0.1) << place;  // of up to 5 N
    }
  }
}

TEST(ContactIndexedField, BeginsWithoutTheZeroOnceItsContactsHaveNeverHadIt) {
  const VariedSprings object;
  const auto field = plain_field();
  Scatter scatter(kSeed);
  for (std::uint64_t contact = 1; contact <= 8; ++contact) {
    const Vector3d here_W = scatter.place();
    enter(*field, contact, here_W);
    EXPECT_EQ(field->has_offset(), contact > 4) << contact;
    for (int i = 0; i < 10; ++i) {
      const At at{scatter.within(0.004), here_W};
      take(*field, observe(contact, at, object.force_N(at) + Vector3d(0.0, 0.0, 1.0)));
    }
  }
}

// A stiffness that drops by a third everywhere: after a few samples the old ones are doubted, here
// and at the next contact.
TEST(ContactIndexedField, ForgetsWhatAChangedObjectContradicts) {
  const VariedSprings object;
  const auto field = plain_field();
  Scatter scatter(kSeed);
  std::uint64_t contact = 0;
  for (int place = 0; place < 4; ++place) {
    const Vector3d here_W(0.01 * place, 0.0, 0.0);
    const double cut = place < 3 ? 1.0 : 0.67;
    enter(*field, ++contact, here_W);
    for (int i = 0; i < 30; ++i) {
      const At at{scatter.within(0.012), here_W};
      take(*field, observe(contact, at, cut * object.force_N(at)));
    }
  }
  double squares_N2 = 0.0;
  double reference_N2 = 0.0;
  for (int i = 0; i < 30; ++i) {
    const At at{scatter.within(0.01), Vector3d(0.03, 0.0, 0.0)};
    squares_N2 += (force_N(*field, at.d) - 0.67 * object.force_N(at)).squaredNorm();
    reference_N2 += (0.67 * object.force_N(at)).squaredNorm();
  }
  EXPECT_LT(std::sqrt(squares_N2 / reference_N2), 0.03);
}

// Other places were softer. An answer from 20 mm away shows it; what the tool has felt here stands.
TEST(ContactIndexedField, DoesNotDoubtWhatTheToolHasFeltByAnAnswerFromElsewhere) {
  const AnchoredSprings object(kSeed);
  ContactIndexedField field({});
  const auto touch = [&](std::uint64_t contact, double strength) {
    const Vector3d point_W(0.03 * static_cast<double>(contact), 0.0, 0.0);
    field.enter_contact(contact, point_W);
    Observation o;
    o.contact = contact;
    o.origin_W = point_W;
    for (int i = 0; i < 12; ++i) {
      o.position_m = Vector3d(0.002 * (i % 3 - 1), 0.002 * (i / 3 % 2), 0.002 * (i / 3));
      o.force_N = strength * object.force_N(o.position_m);
      field.take(o);
    }
    while (field.prepare()) {
    }
    return o;
  };
  touch(1, 1.0);
  touch(2, 1.0);
  Observation answer = touch(3, 1.5);
  const Vector3d felt_m(0.0, 0.0, 0.003);
  const auto error_N = [&] {
    return (field.read(felt_m, kNoHistory).force_N - 1.5 * object.force_N(felt_m)).norm();
  };
  const double before_N = error_N();
  answer.from_query = true;
  answer.position_m = Vector3d(0.02, 0.0, 0.005);
  answer.force_N = 1.5 * object.force_N(answer.position_m);
  ASSERT_TRUE(field.take(answer).surprised);
  while (field.prepare()) {
  }
  EXPECT_LT(error_N(), before_N + 0.002);
}

TEST(ContactIndexedField, KeepsAHundredAndTwentyEightContactsAndNeverMoreThanItsWorkingSet) {
  const VariedSprings object;
  const auto field = plain_field();
  Scatter scatter(kSeed);
  for (std::uint64_t contact = 1; contact <= 200; ++contact) {
    const Vector3d here_W = scatter.place();
    enter(*field, contact, here_W);
    for (int i = 0; i < 8; ++i) {
      const At at{scatter.within(0.012), here_W};
      take(*field, observe(contact, at, object.force_N(at)));
      ASSERT_LE(field->sample_count(), ContactIndexedField::kMaxSamples);
    }
    EXPECT_EQ(field->contacts_kept(),
              std::min(static_cast<int>(contact) - 1, ContactIndexedField::kContacts));
  }
  EXPECT_LT(field->memory_bytes(), 600'000u);
}

TEST(ContactIndexedField, IgnoresALateSampleOfAContactThatIsOver) {
  const VariedSprings object;
  const auto field = plain_field();
  enter(*field, 1, Vector3d::Zero());
  enter(*field, 2, Vector3d(0.01, 0.0, 0.0));
  const At late{Vector3d(0.001, 0.0, 0.0), Vector3d::Zero()};
  take(*field, observe(1, late, object.force_N(late)));
  EXPECT_EQ(field->sample_count(), 0);
}

// A place whose samples were only remembered is known at the next contact there.
TEST(ContactIndexedField, KnowsAPlaceThatItHasRemembered) {
  const AnchoredSprings object(kSeed);
  const Vector3d place_W(0.01, 0.02, 0.0);
  ContactIndexedField field({});
  field.enter_contact(1, place_W);
  while (field.prepare()) {
  }
  Scatter scatter(kSeed);
  for (int i = 0; i < 24; ++i) {
    Observation o;
    o.position_m = scatter.within(0.01);
    o.force_N = object.force_N(o.position_m);
    o.contact = 1;
    o.origin_W = place_W;
    field.remember(o);
  }
  EXPECT_EQ(field.sample_count(), 0) << "nothing is fitted";
  field.enter_contact(2, place_W);
  while (field.prepare()) {
  }
  EXPECT_EQ(field.sample_count(), 24);
  const Vector3d at_m(0.003, -0.002, 0.004);
  const Vector3d expected_N = object.force_N(at_m);
  EXPECT_LT((field.read(at_m, kNoHistory).force_N - expected_N).norm(), 0.02 * expected_N.norm());
}

}  // namespace
}  // namespace forcegrid::kriging
