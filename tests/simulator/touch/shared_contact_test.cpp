// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/shared_contact.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <numeric>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/touch/tool_contact.h"
#include "tests/simulator/two_tool_newton.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kAbove_m = 0.01;
const TwoToolNewton::Points kTouch_W = {Vector3d(-0.018, 0, 0), Vector3d(0.018, 0, 0)};

// A block of 60 x 50 x 40 mm whose top is at z = 0, touched by points that hold 12 mm around them.
Scene block() {
  LatticeBlockOptions options;
  options.vertex_count = {7, 6, 5};
  options.size_m = {0.06, 0.05, 0.04};
  Scene scene;
  scene.name = "little";
  scene.patch_radius_m = 0.012;
  scene.mesh = make_lattice_block(options);
  return scene;
}

ToolOptions point() { return ToolOptions{}; }

void come_down(SharedContact& contact, std::size_t tool) {
  contact.move(tool, kTouch_W[tool] + Vector3d(0, 0, kAbove_m));
  contact.move(tool, kTouch_W[tool]);
}

TEST(SharedContact, TwoToolsTouchAndPullAndFeelWhatADenseNewtonMethodGives) {
  const Scene scene = block();
  SharedContact contact(scene, {}, point(), 2);
  come_down(contact, 0);
  come_down(contact, 1);
  contact.solve();
  ASSERT_TRUE(contact.in_contact(0) && contact.in_contact(1));
  TwoToolNewton reference(scene.mesh, kTouch_W, scene.patch_radius_m);
  const TwoToolNewton::Points moved_W = {Vector3d(-0.001, 0.0015, 0.002),
                                         Vector3d(0.0, -0.001, 0.003)};
  contact.move(0, kTouch_W[0] + moved_W[0]);
  contact.move(1, kTouch_W[1] + moved_W[1]);
  contact.solve();
  const TwoToolNewton::Forces expected = reference.at(moved_W);
  for (std::size_t k = 0; k < 2; ++k) {
    const SharedContact::Answer& answer = contact.answer(k);
    EXPECT_TRUE(answer.in_contact);
    EXPECT_TRUE(answer.equilibrium.converged);
    EXPECT_LT((answer.point_W - kTouch_W[k]).norm(), 1e-9);
    EXPECT_LT((answer.position_W - kTouch_W[k] - moved_W[k]).norm(), 1e-9);
    EXPECT_LT((answer.equilibrium.force_W - expected.tool_W[k]).norm(),
              1e-3 * expected.tool_W[k].norm());
  }
}

TEST(SharedContact, OneToolIsAnsweredAsByItsOwnContact) {
  const Scene scene = block();
  SharedContact shared(scene, {}, point(), 2);
  const auto alone = make_tool_contact(scene, {}, point());
  for (const double z_m : {0.01, 0.004, -0.001, -0.004, 0.002, 0.006}) {
    const Vector3d at_W(0.0051, -0.0048, z_m);
    const SharedContact::Answer expected = alone->step(at_W);
    shared.move(0, at_W);
    shared.solve();
    const SharedContact::Answer& found = shared.answer(0);
    EXPECT_EQ(found.in_contact, expected.in_contact);
    EXPECT_EQ(found.epoch, expected.epoch);
    EXPECT_LT((found.point_W - expected.point_W).norm(), 1e-12);
    EXPECT_LT((found.position_W - expected.position_W).norm(), 1e-9);
    EXPECT_LT((found.equilibrium.force_W - expected.equilibrium.force_W).norm(),
              2e-3 * expected.equilibrium.force_W.norm() + 1e-5);
    EXPECT_FALSE(shared.in_contact(1));
  }
}

TEST(SharedContact, AnotherToolsTouchAndItsEndBeginAnEpoch) {
  SharedContact contact(block(), {}, point(), 2);
  come_down(contact, 0);
  contact.solve();
  EXPECT_EQ(contact.answer(0).epoch, 1U);
  EXPECT_EQ(contact.answer(1).epoch, 0U);
  contact.move(0, kTouch_W[0] + Vector3d(0, 0, 0.004));
  contact.solve();
  EXPECT_EQ(contact.answer(0).epoch, 1U);
  const Vector3d alone_W = contact.answer(0).equilibrium.force_W;

  come_down(contact, 1);
  contact.solve();
  EXPECT_EQ(contact.answer(0).epoch, 2U);
  EXPECT_EQ(contact.answer(1).epoch, 1U);
  contact.move(1, kTouch_W[1] + Vector3d(0.001, 0, 0.006));
  contact.solve();
  EXPECT_EQ(contact.answer(0).epoch, 2U) << "the other's motion begins none";
  EXPECT_GT((contact.answer(0).equilibrium.force_W - alone_W).norm(), 0.05 * alone_W.norm())
      << "but changes the force";

  contact.reset(1);
  contact.solve();
  EXPECT_EQ(contact.answer(0).epoch, 3U);
  EXPECT_TRUE(contact.in_contact(0));
  EXPECT_FALSE(contact.in_contact(1));
  EXPECT_EQ(contact.answer(1).epoch, 0U);
  EXPECT_LT((contact.answer(0).equilibrium.force_W - alone_W).norm(), 2e-3 * alone_W.norm());
}

TEST(SharedContact, StartingOverKeepsTheEpochsRising) {
  SharedContact contact(block(), {}, point(), 2);
  come_down(contact, 0);
  come_down(contact, 1);
  contact.solve();
  const std::uint32_t before = contact.answer(0).epoch;
  contact.start_over();
  EXPECT_FALSE(contact.in_contact(0) || contact.in_contact(1));
  contact.move(0, kTouch_W[0] + Vector3d(0, 0, -0.001));
  contact.solve();
  EXPECT_FALSE(contact.in_contact(0)) << "a tool inside must leave first";
  EXPECT_GT(contact.answer(0).epoch, before);
  come_down(contact, 0);
  contact.solve();
  EXPECT_TRUE(contact.in_contact(0));
}

TEST(SharedContact, APositionThatIsNotFiniteChangesNothing) {
  SharedContact contact(block(), {}, point(), 2);
  come_down(contact, 0);
  contact.move(0, kTouch_W[0] + Vector3d(0, 0, 0.003));
  contact.solve();
  const Vector3d force_W = contact.answer(0).equilibrium.force_W;
  contact.move(0, Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  contact.solve();
  EXPECT_LT((contact.answer(0).equilibrium.force_W - force_W).norm(), 1e-3 * force_W.norm());
  EXPECT_TRUE(contact.answer(0).position_W.allFinite());
}

TEST(SharedContact, PredictsTheTouchOfEachTool) {
  SharedContact contact(block(), {}, point(), 2);
  come_down(contact, 0);
  contact.solve();
  EXPECT_FALSE(contact.expected_touch(0, kTouch_W[0], {0, 0, -0.1}, 0.3));
  const auto touch_W =
      contact.expected_touch(1, kTouch_W[1] + Vector3d(0, 0, kAbove_m), {0, 0, -0.1}, 0.3);
  ASSERT_TRUE(touch_W);
  EXPECT_LT((*touch_W - kTouch_W[1]).norm(), 1e-9);
}

// Asked for elsewhere, it answers what a dense Newton method gives with the other tool where it is,
// and is afterwards where it was.
TEST(SharedContact, AnswersForAPlaceWhereTheToolIsNot) {
  const Scene scene = block();
  SharedContact contact(scene, {}, point(), 2);
  come_down(contact, 0);
  come_down(contact, 1);
  const TwoToolNewton::Points moved_W = {Vector3d(-0.001, 0.0015, 0.002),
                                         Vector3d(0.0, -0.001, 0.003)};
  contact.move(0, kTouch_W[0] + moved_W[0]);
  contact.move(1, kTouch_W[1] + moved_W[1]);
  contact.solve();
  const std::array<SharedContact::Answer, 2> before = {contact.answer(0), contact.answer(1)};
  const Vector3d asked_W(0.001, 0.0, 0.004);
  const SharedContact::Answer found = contact.ask(0, kTouch_W[0] + asked_W);
  TwoToolNewton dense(scene.mesh, kTouch_W, scene.patch_radius_m);
  const Vector3d expected_W = dense.at({asked_W, moved_W[1]}).tool_W[0];
  EXPECT_TRUE(found.in_contact);
  EXPECT_EQ(found.epoch, before[0].epoch);
  EXPECT_LT((found.position_W - kTouch_W[0] - asked_W).norm(), 1e-9);
  EXPECT_LT((found.equilibrium.force_W - expected_W).norm(), 1e-3 * expected_W.norm());
  EXPECT_GT((found.equilibrium.force_W - before[0].equilibrium.force_W).norm(), 0.1);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(contact.answer(k).equilibrium.force_W, before[k].equilibrium.force_W);
  }
  contact.solve();
  for (std::size_t k = 0; k < 2; ++k) {
    const Vector3d& was_W = before[k].equilibrium.force_W;
    EXPECT_LT((contact.answer(k).equilibrium.force_W - was_W).norm(), 2e-3 * was_W.norm());
    EXPECT_EQ(contact.answer(k).epoch, before[k].epoch);
  }
}

TEST(SharedContact, InTheAirAskedForAPlaceItAnswersZero) {
  SharedContact contact(block(), {}, point(), 2);
  come_down(contact, 1);
  contact.solve();
  const SharedContact::Answer found = contact.ask(0, kTouch_W[0]);
  EXPECT_FALSE(found.in_contact);
  EXPECT_EQ(found.epoch, 0U);
  EXPECT_TRUE(found.equilibrium.force_W.isZero(0.0));
}

TEST(SharedContact, ShowsTheObjectUnderBothTools) {
  const Scene scene = block();
  SharedContact contact(scene, {}, point(), 2);
  std::vector<std::int32_t> all(scene.mesh.rest_position_W.size());
  std::iota(all.begin(), all.end(), 0);
  std::vector<Vector3d> at_W;
  contact.copy_positions(all, at_W);
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_LT((at_W[i] - scene.mesh.rest_position_W[i]).norm(), 1e-7) << "at rest";
  }
  come_down(contact, 0);
  come_down(contact, 1);
  const TwoToolNewton::Points moved_W = {Vector3d(-0.001, 0.0015, 0.002),
                                         Vector3d(0.0, -0.001, 0.003)};
  contact.move(0, kTouch_W[0] + moved_W[0]);
  contact.move(1, kTouch_W[1] + moved_W[1]);
  contact.solve();
  contact.copy_positions(all, at_W);
  TwoToolNewton dense(scene.mesh, kTouch_W, scene.patch_radius_m);
  dense.at(moved_W);
  // The solver stops at 0.1 % of the force; the largest move is 3.2 mm.
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_LT((at_W[i] - dense.position_W[i]).norm(), 1e-3 * 3.2e-3) << i;
  }
}

TEST(SharedContact, RefusesAToolThatSlides) {
  ToolOptions sliding;
  sliding.shape = "sphere";
  sliding.contact = "slide";
  EXPECT_THAT([&] { SharedContact(block(), {}, sliding, 2); },
              testing::ThrowsMessage<Error>(testing::HasSubstr("use --contact sticky")));
}

}  // namespace
}  // namespace forcegrid::simulator
