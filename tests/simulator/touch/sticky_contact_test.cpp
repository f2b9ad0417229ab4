// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/sticky_contact.h"

#include <gtest/gtest.h>

#include <limits>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

class StickyContactTest : public ::testing::Test {
 protected:
  SpringMesh mesh_ = make_scene("small", Vector3d(0.1, 0.2, 0.3)).mesh;
  Vector3d top_{0.1, 0.2, 0.3};
  ElasticObject<float> object_{mesh_};
  StickyContact contact_{mesh_};

  StickyContact::Answer step(double x_m, double y_m, double z_m) {
    return contact_.step(object_, top_ + Vector3d(x_m, y_m, z_m));
  }
};

TEST_F(StickyContactTest, BeforeContactForceAndEpochAreZero) {
  const auto answer = step(0, 0, 0.01);
  EXPECT_FALSE(answer.in_contact);
  EXPECT_EQ(answer.epoch, 0U);
  EXPECT_EQ(answer.equilibrium.force_W, Vector3d::Zero());
  EXPECT_TRUE(answer.equilibrium.converged);
  EXPECT_EQ(answer.point_W, top_ + Vector3d(0, 0, 0.01));
  EXPECT_EQ(answer.position_W, answer.point_W);
}

TEST_F(StickyContactTest, TouchingSticksWhereTheToolIsAndTheForceStartsAtZero) {
  step(0.004, 0.003, 0.01);
  const auto touch = step(0.004, 0.003, -0.001);
  EXPECT_TRUE(touch.in_contact);
  EXPECT_EQ(touch.epoch, 1U);
  EXPECT_EQ(touch.point_W, top_ + Vector3d(0.004, 0.003, -0.001));
  EXPECT_LT(touch.equilibrium.force_W.norm(), 1e-4);
  const auto pull = step(0.004, 0.003, 0.009);
  EXPECT_TRUE(pull.in_contact);
  EXPECT_EQ(pull.epoch, 1U);
  EXPECT_EQ(pull.point_W, touch.point_W);
  EXPECT_LT(pull.equilibrium.force_W.z(), -0.1);
  EXPECT_TRUE(pull.equilibrium.displacement_W.isApprox(Vector3d(0, 0, 0.01), 1e-9));
  // Far above the surface it still holds.
  EXPECT_TRUE(step(0.004, 0.003, 0.02).in_contact);
}

TEST_F(StickyContactTest, JustAboveItTouchesOnlyOnTheWayDown) {
  EXPECT_FALSE(step(0, 0, 0.00015).in_contact) << "the first position has no direction";
  EXPECT_FALSE(step(0, 0, 0.00018).in_contact) << "moving up";
  EXPECT_FALSE(step(0, 0, 0.0004).in_contact);
  EXPECT_FALSE(step(0, 0, 0.00021).in_contact) << "too far above";
  EXPECT_TRUE(step(0, 0, 0.00019).in_contact);
}

TEST_F(StickyContactTest, AToolThatIsFirstSeenInsideMustComeOutBeforeItCanTouch) {
  EXPECT_FALSE(step(0.02, 0, -0.02).in_contact);
  EXPECT_FALSE(step(0.01, 0, -0.01).in_contact);
  EXPECT_FALSE(step(0, 0, 0.01).in_contact);
  const auto touch = step(0, 0, -0.0005);
  EXPECT_TRUE(touch.in_contact);
  EXPECT_EQ(touch.point_W, top_ + Vector3d(0, 0, -0.0005));
}

TEST_F(StickyContactTest, BesideTheFootprintThereIsNoContact) {
  EXPECT_FALSE(step(0.0501, 0, -0.001).in_contact);
  EXPECT_FALSE(step(0, -0.0501, -0.001).in_contact);
  EXPECT_TRUE(step(0.0499, 0, -0.001).in_contact);
}

TEST_F(StickyContactTest, WithoutAFreeVertexNearbyThereIsNoContact) {
  // Below the block: inside the footprint and under the surface, but only fixed vertices are near.
  EXPECT_FALSE(step(0, 0, -0.105).in_contact);
  EXPECT_EQ(step(0, 0, -0.105).epoch, 0U);
  // Between the vertices, 10 mm apart, a patch of 1 mm holds nothing.
  ContactOptions narrow;
  narrow.patch_radius_m = 0.001;
  StickyContact contact(mesh_, narrow);
  EXPECT_FALSE(contact.step(object_, top_ + Vector3d(0.005, 0.005, 0)).in_contact);
}

TEST_F(StickyContactTest, ReleaseIsANewEpochAndTheToolMustLeaveFirst) {
  step(0, 0, 0.01);
  step(0, 0, -0.001);
  step(0, 0, -0.002);
  contact_.release(object_);
  const auto free = step(0, 0, -0.002);
  EXPECT_FALSE(free.in_contact);
  EXPECT_EQ(free.epoch, 2U);
  EXPECT_EQ(free.equilibrium.force_W, Vector3d::Zero());
  step(0, 0, 0.01);
  const auto again = step(0, 0, -0.001);
  EXPECT_TRUE(again.in_contact);
  EXPECT_EQ(again.epoch, 3U);
}

TEST_F(StickyContactTest, ResetBeginsANewRun) {
  step(0, 0, 0.01);
  ASSERT_TRUE(step(0, 0, -0.001).in_contact);
  step(0, 0, 0.01);
  contact_.reset(object_);
  const auto answer = step(0, 0, 0.01);
  EXPECT_FALSE(answer.in_contact);
  EXPECT_EQ(answer.epoch, 0U);
  EXPECT_FALSE(object_.grabbed());
}

TEST_F(StickyContactTest, APositionThatIsNotFiniteIsNoTouchAndNoMove) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(step(0, 0, nan).in_contact);
  EXPECT_FALSE(step(nan, 0, -0.001).equilibrium.converged);
  step(0, 0, 0.01);
  step(0, 0, -0.001);
  const auto pull = step(0, 0, 0.009);
  const auto answer = step(0, 0, nan);
  EXPECT_TRUE(answer.in_contact);
  EXPECT_FALSE(answer.equilibrium.converged);
  EXPECT_EQ(answer.equilibrium.force_W, pull.equilibrium.force_W);
  EXPECT_TRUE(answer.position_W.isApprox(top_ + Vector3d(0, 0, 0.009), 1e-12));
}

TEST_F(StickyContactTest, RefusesOptionsOutOfRange) {
  ContactOptions options;
  options.patch_radius_m = 0.0;
  EXPECT_THROW(StickyContact(mesh_, options), Error);
  options = {};
  options.approach_distance_m = -1.0;
  EXPECT_THROW(StickyContact(mesh_, options), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
