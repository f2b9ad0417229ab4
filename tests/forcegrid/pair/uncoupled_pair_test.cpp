// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/uncoupled_pair.h"

#include <gtest/gtest.h>

#include <string>

#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "tests/forcegrid/pair/series_springs.h"

namespace forcegrid {
namespace {

constexpr int kAllWork = 1 << 30;

// Each tool's force is exactly that of a method which has only ever seen this tool.
TEST(UncoupledPair, IsAMethodForEachToolThatNeverHearsOfTheOther) {
  const testing::SeriesSprings object;
  for (const std::string name : {"hold", "rls", "kriging"}) {
    const auto both = make_pair_force_method(name, {});
    EXPECT_EQ(both->name(), name);
    const auto left = make_force_method(name, {});
    const auto right = make_force_method(name, {});
    testing::RandomPositions positions(3, 0.01);
    const PairVector touched = PairVector::Constant(0.05);
    both->contacts_made(1, touched);
    left->contact_made(1, touched.head<3>());
    right->contact_made(1, touched.tail<3>());
    for (int i = 0; i < 40; ++i) {
      const double time_s = i / 30.0;
      const PairVector p = positions.next();
      PairSample sample;
      sample.time_s = time_s;
      sample.positions_W = touched + p;
      sample.forces_W = object.forces_N(p);
      sample.contact_epoch = 1;
      sample.contact_points_W = touched;
      both->take_sample(sample);
      Sample own;
      own.time_s = time_s;
      own.contact_epoch = 1;
      own.position_W = sample.positions_W.head<3>();
      own.force_W = sample.forces_W.head<3>();
      own.contact_point_W = touched.head<3>();
      left->take_sample(own);
      own.position_W = sample.positions_W.tail<3>();
      own.force_W = sample.forces_W.tail<3>();
      own.contact_point_W = touched.tail<3>();
      right->take_sample(own);
      both->observe(time_s, sample.positions_W);
      left->observe(time_s, sample.positions_W.head<3>());
      right->observe(time_s, sample.positions_W.tail<3>());
      EXPECT_EQ(both->work(kAllWork), left->work(kAllWork / 2) + right->work(kAllWork / 2));
      const PairVector at = touched + positions.next();
      const PairVector found = both->forces(time_s, at).forces_W;
      EXPECT_EQ(found.head<3>(), left->force(time_s, at.head<3>()).force_W) << name << i;
      EXPECT_EQ(found.tail<3>(), right->force(time_s, at.tail<3>()).force_W) << name << i;
    }
    both->contacts_lost();
    EXPECT_EQ(both->forces(2.0, touched).forces_W, PairVector::Zero());
    EXPECT_EQ(both->memory_bytes(),
              sizeof(UncoupledPair) + left->memory_bytes() + right->memory_bytes());
  }
}

// Each tool's method gets its own block of the stiffness.
TEST(UncoupledPair, GivesEachToolItsOwnStiffness) {
  const testing::SeriesSprings object;
  const auto both = make_pair_force_method("auto", {});
  const auto left = make_force_method("auto", {});
  const PairVector touched = PairVector::Constant(0.05);
  both->contacts_made(1, touched);
  left->contact_made(1, touched.head<3>());
  testing::RandomPositions positions(3, 0.01);
  for (int i = 0; i < 20; ++i) {
    const PairVector p = positions.next();
    PairSample sample;
    sample.time_s = i / 30.0;
    sample.positions_W = touched + p;
    sample.forces_W = object.forces_N(p);
    sample.has_stiffness = true;
    sample.stiffness_W = object.stiffness_N_per_m();
    sample.contact_epoch = 1;
    sample.contact_points_W = touched;
    both->take_sample(sample);
    Sample own;
    own.time_s = sample.time_s;
    own.contact_epoch = 1;
    own.position_W = sample.positions_W.head<3>();
    own.force_W = sample.forces_W.head<3>();
    own.has_stiffness = true;
    own.stiffness_W = sample.stiffness_W.topLeftCorner<3, 3>();
    own.contact_point_W = touched.head<3>();
    left->take_sample(own);
    both->observe(sample.time_s, sample.positions_W);
    left->observe(sample.time_s, own.position_W);
    both->work(kAllWork);
    left->work(kAllWork / 2);
    const PairVector at = touched + positions.next();
    EXPECT_EQ(both->forces(sample.time_s, at).forces_W.head<3>(),
              left->force(sample.time_s, at.head<3>()).force_W)
        << i;
  }
}

// A tool outside of its grid makes the pair's answer partial, and leaves the other's force alone.
TEST(UncoupledPair, HasTheWorseStatusOfItsTools) {
  MethodOptions options;
  options.grid.max_W.setConstant(0.1);
  options.grid.cells.setConstant(10);
  const auto both = make_pair_force_method("forcegrid", options);
  both->contacts_made(1, PairVector::Constant(0.05));
  PairSample sample;
  sample.positions_W.setConstant(0.05);
  sample.forces_W.setConstant(1.0);
  both->take_sample(sample);
  while (both->work(kAllWork) > 0) {
  }
  PairVector at = PairVector::Constant(0.05);
  EXPECT_EQ(both->forces(0.1, at).status, EstimateStatus::kOk);
  at[4] = 0.2;
  const PairEstimate partial = both->forces(0.1, at);
  EXPECT_EQ(partial.status, EstimateStatus::kOutside);
  EXPECT_NEAR(partial.forces_W[0], 1.0, 1e-6);
  EXPECT_EQ(partial.forces_W.tail<3>(), Eigen::Vector3d::Zero());
}

}  // namespace
}  // namespace forcegrid
