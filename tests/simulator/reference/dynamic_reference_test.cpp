// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/dynamic_reference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "simulator/mesh/error.h"
#include "simulator/solver/elastic_object.h"
#include "tests/simulator/little_jelly.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

class DynamicReference : public ::testing::Test {
 protected:
  // Up by 4 mm in 20 cycles of 2 ms, and still from then on; the tool touched at the origin.
  void make_path(int cycles, double jitter_m) {
    for (int i = 0; i < cycles; ++i) {
      positions_W_.emplace_back(0.0, 0.0,
                                std::min(i + 1, 20) * 0.2e-3 + (i % 2 == 0 ? jitter_m : 0.0));
      times_s_.push_back(2e-3 * i);
    }
  }

  std::string complaint() const {
    try {
      simulate_dynamic_reference(scene_, positions_W_, times_s_, options_);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  Scene scene_ = testing::little_jelly();
  std::vector<Vector3d> positions_W_;
  std::vector<double> times_s_;
  ReferenceOptions options_;
};

TEST_F(DynamicReference, IsMoreThanTheEquilibriumWhileTheToolMovesAndBecomesItAfterwards) {
  make_path(320, 0.0);
  const ReferenceSolution reference =
      simulate_dynamic_reference(scene_, positions_W_, times_s_, options_);
  EXPECT_EQ(reference.unconverged, 0U);
  EXPECT_FALSE(reference.cancelled);
  ASSERT_EQ(reference.forces_W.size(), positions_W_.size());
  ElasticObject<double> still(scene_.mesh, {.relative_tolerance = 1e-6});
  ASSERT_GT(still.grab(Vector3d::Zero(), scene_.patch_radius_m), 0);
  const Vector3d half_W = still.move_to(positions_W_[9]).force_W;
  EXPECT_LT(reference.forces_W[9].z(), 1.5 * half_W.z()) << "inertia and dampers pull as well";
  const Vector3d end_W = still.move_to(positions_W_.back()).force_W;
  EXPECT_LT((reference.forces_W.back() - end_W).norm(), 0.02 * end_W.norm());
}

TEST_F(DynamicReference, AnEncoderCountToAndFroIsNoMotion) {
  make_path(60, 0.0);
  const ReferenceSolution clean =
      simulate_dynamic_reference(scene_, positions_W_, times_s_, options_);
  positions_W_.clear();
  times_s_.clear();
  make_path(60, 0.02e-3);
  const ReferenceSolution noisy =
      simulate_dynamic_reference(scene_, positions_W_, times_s_, options_);
  // 0.02 mm each 2 ms are 10 mm/s; smoothed over five cycles 2 mm/s are left.
  for (std::size_t i = 30; i + 3 < clean.forces_W.size(); ++i) {
    EXPECT_LT((noisy.forces_W[i] - clean.forces_W[i]).norm(), 0.05 * clean.forces_W[i].norm());
  }
}

TEST_F(DynamicReference, StopsWhenItIsTold) {
  make_path(50, 0.0);
  const std::atomic<bool> stop{true};
  options_.cancel = &stop;
  const ReferenceSolution reference =
      simulate_dynamic_reference(scene_, positions_W_, times_s_, options_);
  EXPECT_TRUE(reference.cancelled);
  EXPECT_EQ(reference.known.front(), 0);
}

TEST_F(DynamicReference, RefusesPathsThatAreNone) {
  make_path(5, 0.0);
  EXPECT_EQ(complaint(), "");
  times_s_[3] = times_s_[2];
  EXPECT_THAT(complaint(), HasSubstr("time 3 is not after"));
  times_s_.pop_back();
  EXPECT_THAT(complaint(), HasSubstr("5 positions and 4 times"));
  positions_W_.pop_back();
  positions_W_[1].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(complaint(), HasSubstr("not finite"));
  options_.first_contact_cycle = 9;
  EXPECT_THAT(complaint(), HasSubstr("first cycle with contact is 9"));
  options_.first_contact_cycle = 0;
  positions_W_[1].x() = 0.0;
  times_s_ = {0, 1, 2, 3};
  options_.contact_point_W = {1, 1, 1};
  EXPECT_THAT(complaint(), HasSubstr("no free vertex"));
  scene_ = make_scene("small");
  EXPECT_THAT(complaint(), HasSubstr("mass_kg"));
}

}  // namespace
}  // namespace forcegrid::simulator
