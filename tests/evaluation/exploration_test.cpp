// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/exploration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "evaluation/motions/trajectories.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A table of polynomial forces of second degree, which its splines reproduce exactly.
template <typename Force>
ForceTable table_of(const Force& force_N) {
  const TableLattice lattice;
  std::vector<Vector3d> forces_W;
  for (std::size_t i = 0; i < lattice.node_count(); ++i) {
    forces_W.push_back(force_N(lattice.node_W_m(i)));
  }
  return ForceTable(lattice, forces_W);
}

// -grad of (x^2 + 2 y^2 + 3 z^2 + x y) 50 N/m + (x^2 z + y^3) 2000 N/m^2
Vector3d conservative_N(const Vector3d& p) {
  return {-50.0 * (2.0 * p.x() + p.y()) - 4000.0 * p.x() * p.z(),
          -50.0 * (4.0 * p.y() + p.x()) - 6000.0 * p.y() * p.y(),
          -300.0 * p.z() - 2000.0 * p.x() * p.x()};
}

TEST(LargeObject, OfALinearSpringIsASineOfTwiceTheFolds) {
  constexpr double kStiffness_N_per_m = 100.0;
  const ForceTable table =
      table_of([](const Vector3d& p) { return Vector3d(-kStiffness_N_per_m * p); });
  // a k A cos(u) sin(u) along x and y, with u = (d - o) / A; unfolded, a k z along z.
  const auto expected_N = [](const Vector3d& d) {
    Vector3d force = Vector3d::Zero();
    const double share[2] = {0.6, 0.5};
    const double offset_m[2][2] = {{0.010, -0.015}, {-0.022, 0.018}};
    for (int fold = 0; fold < 2; ++fold) {
      for (int axis = 0; axis < 2; ++axis) {
        force[axis] -= 0.5 * share[fold] * kStiffness_N_per_m * 0.020 *
                       std::sin(2.0 * (d[axis] - offset_m[fold][axis]) / 0.020);
      }
      force.z() -= share[fold] * kStiffness_N_per_m * d.z();
    }
    return force;
  };
  for (const Vector3d& d : {Vector3d(0.0, 0.0, 0.0), Vector3d(0.05, -0.04, 0.02),
                            Vector3d(-0.013, 0.031, 0.007), Vector3d(0.2, 0.1, -0.005)}) {
    const Vector3d force_N = large_object(table, d).force_W;
    EXPECT_LT((force_N - (expected_N(d) - expected_N(Vector3d::Zero()))).norm(), 1e-9)
        << d.transpose();
  }
}

TEST(LargeObject, HasItsDerivativeAsStiffnessWhichIsSymmetricWhereTheTableIsConservative) {
  const ForceTable table = table_of(conservative_N);
  constexpr double kStep_m = 1e-5;
  for (const Vector3d& d :
       {Vector3d(0.0, 0.0, 0.001), Vector3d(0.05, -0.04, 0.02), Vector3d(-0.013, 0.031, 0.007)}) {
    const Matrix3d j = large_object(table, d).stiffness_W;
    EXPECT_LT((j - j.transpose()).norm(), 1e-6 * j.norm()) << "no curl";
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d step = kStep_m * Vector3d::Unit(axis);
      const Vector3d difference =
          (large_object(table, d + step).force_W - large_object(table, d - step).force_W) /
          (2.0 * kStep_m);
      EXPECT_LT((j.col(axis) - difference).norm(), 1e-5 * j.norm()) << axis;
    }
  }
}

TEST(LargeObject, RefusesADisplacementAboveTheTable) {
  EXPECT_THROW(large_object(table_of(conservative_N), Vector3d(0.0, 0.0, 0.03)), ChartError);
}

TEST(Exploration, StaysInEachTileAndReturnsToEachAfterTwoMinutesOnAnotherPath) {
  const Trajectory trajectory("exploration", 3);
  EXPECT_EQ(trajectory.duration_s(), 234.0);
  EXPECT_TRUE(trajectory.is_exploration());
  EXPECT_FALSE(trajectory.is_static());
  double apart_m = 0.0;
  for (int visit = 0; visit < kTileVisits; ++visit) {
    EXPECT_EQ(tile_centre_W_m(visit), tile_centre_W_m(visit % kTiles));
    for (double since_s = 1.0; since_s < kTileStay_s; since_s += 0.01) {
      const double time_s = visit * kTileStay_s + since_s;
      const Vector3d d = trajectory.position_W(time_s) - first_contact_point_W();
      ASSERT_LE((d - tile_centre_W_m(visit)).head<2>().cwiseAbs().maxCoeff(), 0.5 * kTileSide_m);
      if (visit >= kTiles) {
        const Vector3d before_m =
            trajectory.position_W(time_s - kTiles * kTileStay_s) - first_contact_point_W();
        apart_m += (d - before_m).norm() / (kTiles * 1200.0);
      }
    }
  }
  EXPECT_GT(apart_m, 0.008) << "mean distance between the first and the second path";
  for (int one = 0; one < kTiles; ++one) {
    for (int other = 0; other < one; ++other) {
      EXPECT_GE((tile_centre_W_m(one) - tile_centre_W_m(other)).norm(), kTileSide_m - 1e-12);
    }
  }
}

// A tool that is at each tile's centre from 0.5 s after the visit's beginning on, and elsewhere
// before it; errors of known size in each window.
TEST(ReturnErrors, AreThoseOfTheWindowsAfterEnteringATileAgain) {
  std::vector<ServoInstant> servo;
  std::vector<Vector3d> forces_W;
  const Vector3d point_W(0.1, 0.2, 0.3);
  for (int i = 0; i < static_cast<int>(kExploration_s * 1000.0); ++i) {
    ServoInstant instant;
    instant.time_s = 1e-3 * (i + 0.5);  // never on the edge of a window
    const int visit = static_cast<int>(instant.time_s / kTileStay_s);
    const double since_s = instant.time_s - visit * kTileStay_s - 0.5;
    instant.position_W = point_W + tile_centre_W_m(visit) +
                         (since_s < 0.0 ? Vector3d(0.3, 0.0, 0.0) : Vector3d(0.01, 0.0, 0.02));
    instant.force_W = Vector3d(0.0, 2.0, 0.0);
    const double error_N = since_s < 0.0     ? 0.5
                           : since_s < 0.033 ? 0.1
                           : since_s < 0.1   ? 0.2
                           : since_s < 0.5   ? 0.3
                           : since_s < 1.0   ? 0.4
                                             : 0.0;
    servo.push_back(instant);
    forces_W.push_back(instant.force_W + Vector3d(visit < kTiles ? 1.0 : error_N, 0.0, 0.0));
  }
  const ReturnErrors errors = return_errors(servo, point_W, forces_W);
  // Entered with the first instant in the tile, half a millisecond after the half second.
  EXPECT_NEAR(errors.first_33ms_percent, 5.0, 0.2);
  EXPECT_NEAR(errors.to_100ms_percent, 10.0, 0.1);
  EXPECT_NEAR(errors.to_500ms_percent, 15.0, 0.1);
  EXPECT_NEAR(errors.to_1s_percent, 20.0, 0.1);
  const double mean_square_N2 =
      (0.5 * 0.25 + 0.033 * 0.01 + 0.067 * 0.04 + 0.4 * 0.09 + 0.5 * 0.16) / kTileStay_s;
  EXPECT_NEAR(errors.second_half_percent, 50.0 * std::sqrt(mean_square_N2), 0.05);

  servo.resize(1000);
  EXPECT_TRUE(std::isnan(return_errors(servo, point_W, forces_W).first_33ms_percent));
}

}  // namespace
}  // namespace forcegrid::evaluation
