// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/variation.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "forcegrid/methods.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr std::uint64_t kSeed = 2;

// A hardening object: the gradient of -(1/2 d.K d + 1/4 h |d|^4).
const Vector3d kStiffness_N_per_m{80.0, 110.0, 130.0};
constexpr double kHardening_N_per_m3 = 1.5e5;

const ForceTable& object() {
  static const ForceTable table = [] {
    const TableLattice lattice;
    std::vector<Vector3d> forces_W;
    for (std::size_t i = 0; i < lattice.node_count(); ++i) {
      const Vector3d d = lattice.node_W_m(i);
      forces_W.push_back(-kStiffness_N_per_m.cwiseProduct(d) -
                         kHardening_N_per_m3 * d.squaredNorm() * d);
    }
    return ForceTable(lattice, forces_W);
  }();
  return table;
}

TEST(VariedObject, IsStifferSofterAndTurnedFromPlaceToPlaceButConservative) {
  const VariedObject varied(object(), kSeed);
  double softest = 2.0, stiffest = 0.0, furthest_rad = 0.0;
  for (double x = -0.06; x <= 0.06; x += 0.002) {
    for (double y = -0.06; y <= 0.06; y += 0.002) {
      const Vector3d c = first_contact_point_W() + Vector3d(x, y, 0.0);
      softest = std::min(softest, varied.stiffness_factor(c));
      stiffest = std::max(stiffest, varied.stiffness_factor(c));
      furthest_rad = std::max(furthest_rad, std::abs(varied.turn_rad(c)));
    }
  }
  EXPECT_NEAR(softest, 0.7, 0.01);
  EXPECT_NEAR(stiffest, 1.3, 0.01);
  EXPECT_NEAR(furthest_rad, 0.6, 0.01);

  const Vector3d c = first_contact_point_W() + Vector3d(0.012, -0.007, 0.0);
  EXPECT_LT(varied.at(c, Vector3d::Zero()).force_W.norm(), 1e-12);
  const Vector3d d(0.006, -0.004, 0.009);
  const ForceTable::Value value = varied.at(c, d);
  const Eigen::Rotation2Dd turn(varied.turn_rad(c));
  Vector3d turned = d;
  turned.head<2>() = turn.inverse() * d.head<2>();
  Vector3d force_W = varied.stiffness_factor(c) * object().force_W(turned);
  force_W.head<2>() = Eigen::Vector2d(turn * force_W.head<2>());
  EXPECT_LT((value.force_W - force_W).norm(), 1e-12);
  EXPECT_LT((value.stiffness_W - value.stiffness_W.transpose()).norm(), 1e-9);
  constexpr double kStep_m = 1e-6;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step = kStep_m * Vector3d::Unit(axis);
    const Vector3d slope =
        (varied.at(c, d + step).force_W - varied.at(c, d - step).force_W) / (2.0 * kStep_m);
    EXPECT_LT((value.stiffness_W.col(axis) - slope).norm(), 1e-4);  // of some 100 N/m
  }
}

TEST(Visits, ComeBackToNinePlacesAfterMoreThanAMinute) {
  const Visits visits(kSeed);
  ASSERT_EQ(visits.contacts().size(), 90u);
  for (std::size_t i = 0; i < 45; ++i) {
    const ContactSpan& first = visits.contacts()[i];
    const ContactSpan& again = visits.contacts()[i + 45];
    EXPECT_NEAR(again.begin_s - first.begin_s, 81.0, 1e-9);
    EXPECT_LT((again.point_W - first.point_W).cwiseAbs().maxCoeff(), 0.0081);
    EXPECT_GT((again.point_W - first.point_W).norm(), 0.0);
    for (std::size_t j = 0; j < i / 5 * 5; ++j) {
      EXPECT_GT((first.point_W - visits.contacts()[j].point_W).norm(), 0.0119);
    }
  }
}

TEST(Visits, MoveWithoutAJumpAndApproachStraightAtFiftyMillimetresASecond) {
  const Visits visits(kSeed);
  constexpr double kCycle_s = 0.002;
  Vector3d before = visits.position_W(0.0);
  for (int i = 1; i < static_cast<int>(visits.duration_s() / kCycle_s); ++i) {
    const Vector3d now = visits.position_W(i * kCycle_s);
    EXPECT_LT((now - before).norm(), 0.0012) << i;  // 0.6 m/s
    before = now;
  }
  for (const ContactSpan& span : visits.contacts()) {
    EXPECT_LT((visits.position_W(span.begin_s) - span.point_W).norm(), 1e-9);
    const Vector3d early = visits.position_W(span.begin_s - 0.2);
    const Vector3d velocity =
        (visits.position_W(span.begin_s - 0.198) - visits.position_W(span.begin_s - 0.2)) / 0.002;
    EXPECT_LT((velocity - Vector3d(0.0, 0.0, -0.05)).norm(), 1e-9);
    const auto expected = visits.expected_point_W(early, velocity);
    ASSERT_TRUE(expected.has_value());
    EXPECT_LT((*expected - span.point_W).norm(), 1e-9);
    EXPECT_FALSE(visits.expected_point_W(early, -velocity).has_value());
    EXPECT_FALSE(visits.expected_point_W(early, 0.1 * velocity).has_value()) << "in 2 s";
  }
}

VisitsVerdict judged(const char* name, double requests_per_s) {
  const auto method = make_force_method(name, {});
  VisitsOptions options;
  options.servo_rate_Hz = 250.0;
  options.seed = kSeed;
  options.requests_per_s = requests_per_s;
  return judge_visits(*method, object(), options);
}

TEST(JudgeVisits, FindsKrigingContactRightFromTheFirstTouchAndHoldNot) {
  const VisitsVerdict hold = judged("hold", 0.0);
  EXPECT_GT(hold.errors.returns.first_67ms_percent, 5.0);
  EXPECT_GT(hold.verdict.reference_rms_N, 0.5);
  const VisitsVerdict alone = judged("kriging-contact", 0.0);
  EXPECT_LT(alone.errors.returns.first_67ms_percent, 0.3);
  EXPECT_LT(alone.errors.second_tour.first_67ms_percent, 0.3);
  EXPECT_LT(alone.errors.first_tour.first_67ms_percent, 2.5);
  EXPECT_GT(alone.errors.first_contact.first_67ms_percent, 3.0) << "nothing was known before";
  EXPECT_EQ(alone.verdict.requests_answered, 0u);
  const VisitsVerdict asking = judged("kriging-contact", 120.0);
  EXPECT_GT(asking.verdict.requests_answered, 50u);
  EXPECT_LT(asking.errors.first_contact.first_67ms_percent, 0.5);
  EXPECT_LT(asking.errors.unknown_places.first_67ms_percent, 0.5);
  EXPECT_LT(asking.errors.returns.first_67ms_percent, 0.3);
  const VisitsVerdict best = judged("auto", 0.0);
  EXPECT_LT(best.errors.returns.first_67ms_percent, 0.3);
  EXPECT_LT(best.errors.unknown_places.first_67ms_percent, 5.0);
}

}  // namespace
}  // namespace forcegrid::evaluation
