// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/two_rates_object.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/touch/two_rates_contact.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kPatch_m = 0.012;

// It gives way as a whole, so that a small region alone goes wrong.
SpringMesh little_block() {
  LatticeBlockOptions options;
  options.vertex_count = {12, 12, 9};
  options.law.cubic_coefficient = 5.0;
  return make_lattice_block(options);
}

TwoRatesOptions by_hand() {
  TwoRatesOptions options = two_rates_options(500.0, {});
  options.near.most_vertices = 300;
  options.own_thread = false;
  return options;
}

// Of 6 mm, begun at rest; a cycle of 2 ms goes up to 0.18 mm.
Vector3d circle_W(int cycle) {
  const double phase = 0.03 * cycle;
  return {0.006 * std::sin(phase), 0.0, 0.006 * (1.0 - std::cos(phase))};
}

void finish_whole(TwoRatesObject& object) {
  if (object.whole_is_due()) {
    object.solve_whole();
    object.hand_over();
  }
}

// RMS over RMS of the converged force; the whole comes `delay` cycles late, never for 0.
double error_with(const SpringMesh& mesh, const TwoRatesOptions& options, int delay) {
  ElasticObject<double> reference(mesh, {.relative_tolerance = 1e-7});
  TwoRatesObject object(mesh, options);
  EXPECT_EQ(object.grab(Vector3d::Zero(), kPatch_m), reference.grab(Vector3d::Zero(), kPatch_m));
  double error_N2 = 0.0;
  double force_N2 = 0.0;
  for (int cycle = 1; cycle <= 200; ++cycle) {
    const Equilibrium answer = object.move_to(circle_W(cycle));
    const Vector3d expected_W = reference.move_to(circle_W(cycle)).force_W;
    EXPECT_LE(answer.vertices, 700) << cycle;
    error_N2 += (answer.force_W - expected_W).squaredNorm();
    force_N2 += expected_W.squaredNorm();
    if (delay > 0 && cycle % delay == 0) {
      finish_whole(object);
    }
  }
  return std::sqrt(error_N2 / force_N2);
}

TEST(TwoRatesObject, TheWholeMendsWhatTheRegionMissesEvenIfItComesLate) {
  const SpringMesh mesh = little_block();
  const double alone = error_with(mesh, by_hand(), 0);
  EXPECT_GT(alone, 0.01) << "the region suffices by itself, so that this test shows nothing";
  EXPECT_LT(error_with(mesh, by_hand(), 1), 1e-3);
  EXPECT_LT(error_with(mesh, by_hand(), 8), 0.2 * alone);
}

TEST(TwoRatesObject, TheWholeIsTakenInForWhereTheToolHasGoneSince) {
  const SpringMesh mesh = little_block();
  TwoRatesObject object(mesh, by_hand());
  ElasticObject<double> reference(mesh, {.relative_tolerance = 1e-7});
  object.grab(Vector3d::Zero(), kPatch_m);
  reference.grab(Vector3d::Zero(), kPatch_m);
  const auto error_at = [&](const Vector3d& at_W) {
    const Vector3d expected_W = reference.move_to(at_W).force_W;
    return (object.move_to(at_W).force_W - expected_W).norm() / expected_W.norm();
  };
  finish_whole(object);  // it takes hold
  for (int cycle = 1; cycle <= 40; ++cycle) {
    error_at({0.0, 0.0, 1e-4 * cycle});
  }
  // What it was asked for at the first move, 4 mm away from here.
  finish_whole(object);
  EXPECT_EQ(object.whole_solutions(), 0U);
  const double before = error_at({0.0, 0.0, 41e-4});
  EXPECT_EQ(object.whole_solutions(), 1U);
  finish_whole(object);
  const double after = error_at({0.0, 0.0, 42e-4});
  EXPECT_EQ(object.whole_solutions(), 2U);
  EXPECT_LT(after, 1e-3);
  EXPECT_LT(after, 0.5 * before);
}

TEST(TwoRatesObject, ItsCostDoesNotGrowWithTheObject) {
  LatticeBlockOptions larger;
  larger.vertex_count = {22, 22, 21};
  larger.size_m = Vector3d(22.0, 22.0, 21.0) * 0.1 / 12.0;  // as dense as the little one
  int most[2] = {};
  for (int k = 0; k < 2; ++k) {
    TwoRatesObject object(k == 0 ? little_block() : make_lattice_block(larger), by_hand());
    object.grab(Vector3d::Zero(), kPatch_m);
    finish_whole(object);
    for (int cycle = 1; cycle <= 40; ++cycle) {
      most[k] = std::max(most[k], object.move_to(circle_W(cycle)).vertices);
      finish_whole(object);
    }
  }
  EXPECT_GT(most[0], 300);  // the region and its border
  EXPECT_LT(most[1], 2 * most[0]);
}

TEST(TwoRatesObject, SaysWhenNobodyKnowsWhatLiesAround) {
  const SpringMesh mesh = little_block();
  TwoRatesOptions options = by_hand();
  options.near.most_vertices = 30;
  TwoRatesObject object(mesh, options);
  object.grab(Vector3d::Zero(), kPatch_m);
  bool converged = true;
  for (int cycle = 1; cycle <= 100; ++cycle) {
    converged = object.move_to(circle_W(cycle)).converged;
  }
  EXPECT_FALSE(converged);
}

TEST(TwoRatesObject, BeginsAnewWhereverItTakesHoldNext) {
  const SpringMesh mesh = little_block();
  TwoRatesObject object(mesh, by_hand());
  for (const Vector3d& point_W : {Vector3d(0.0, 0.0, 0.0), Vector3d(0.02, 0.01, 0.0)}) {
    ElasticObject<double> reference(mesh, {.relative_tolerance = 1e-7});
    ASSERT_EQ(object.grab(point_W, kPatch_m), reference.grab(point_W, kPatch_m));
    Vector3d found_W;
    Vector3d expected_W;
    for (int cycle = 1; cycle <= 60; ++cycle) {
      found_W = object.move_to(circle_W(cycle)).force_W;
      expected_W = reference.move_to(circle_W(cycle)).force_W;
      finish_whole(object);
    }
    EXPECT_LT((found_W - expected_W).norm(), 2e-3 * expected_W.norm()) << point_W.transpose();
    object.release();
    EXPECT_EQ(object.move_to({0.001, 0.0, 0.0}).force_W, Vector3d::Zero());
  }
}

// A whole solution that was asked for before the tool let go belongs to another grip.
TEST(TwoRatesObject, LeavesALateSolutionOfTheLastGripAside) {
  const SpringMesh mesh = little_block();
  TwoRatesObject object(mesh, by_hand());
  object.grab(Vector3d::Zero(), kPatch_m);
  finish_whole(object);
  object.move_to({0.0, 0.0, 0.005});
  ASSERT_TRUE(object.whole_is_due());
  object.release();
  object.grab({0.02, 0.01, 0.0}, kPatch_m);
  finish_whole(object);  // of the first grip
  ElasticObject<double> reference(mesh, {.relative_tolerance = 1e-7});
  reference.grab({0.02, 0.01, 0.0}, kPatch_m);
  const Vector3d at_W(0.0, 0.0, 0.0005);
  const Vector3d expected_W = reference.move_to(at_W).force_W;
  EXPECT_LT((object.move_to(at_W).force_W - expected_W).norm(), 0.02 * expected_W.norm());
  EXPECT_EQ(object.whole_solutions(), 0U);
}

TEST(TwoRatesObject, AMoveToNowhereChangesNothing) {
  TwoRatesObject object(little_block(), by_hand());
  object.grab(Vector3d::Zero(), kPatch_m);
  finish_whole(object);
  const Vector3d before_W = object.move_to({0.0, 0.0, 0.001}).force_W;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Equilibrium answer = object.move_to({nan, 0.0, 0.0});
  EXPECT_FALSE(answer.converged);
  EXPECT_FALSE(answer.reached);
  EXPECT_EQ(answer.force_W, before_W);
  finish_whole(object);
  EXPECT_TRUE(object.move_to({0.0, 0.0, 0.001}).force_W.allFinite());
}

// With its own thread nothing can be said of when the whole comes, only that it does. That thread
// has the least priority: beside busy tests it gets a hundredth of a core.
TEST(TwoRatesObject, ItsOwnThreadHandsTheWholeOver) {
  const SpringMesh mesh = little_block();
  TwoRatesOptions options = by_hand();
  options.own_thread = true;
  TwoRatesObject object(mesh, options);
  ElasticObject<double> reference(mesh, {.relative_tolerance = 1e-7});
  reference.grab(Vector3d::Zero(), kPatch_m);
  object.grab(Vector3d::Zero(), kPatch_m);
  for (int cycle = 1; cycle <= 60; ++cycle) {
    object.move_to(circle_W(cycle));
    reference.move_to(circle_W(cycle));
  }
  const Vector3d expected_W = reference.move_to(circle_W(60)).force_W;
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(200);
  double error = 1.0;
  while (error > 1e-3 && std::chrono::steady_clock::now() < give_up) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    error = (object.move_to(circle_W(60)).force_W - expected_W).norm() / expected_W.norm();
  }
  EXPECT_LE(error, 1e-3);
  EXPECT_GT(object.whole_solutions(), 0U);
}

// As when the machine has no time for the whole: it is far behind when it gets some.
TEST(TwoRatesObject, TheWholeComesToAToolThatWentFarWithoutItAndRests) {
  const SpringMesh mesh = little_block();
  TwoRatesObject object(mesh, by_hand());
  ElasticObject<double> reference(mesh, {.relative_tolerance = 1e-7});
  reference.grab(Vector3d::Zero(), kPatch_m);
  object.grab(Vector3d::Zero(), kPatch_m);
  Vector3d expected_W = Vector3d::Zero();
  for (int cycle = 1; cycle <= 60; ++cycle) {
    object.move_to(circle_W(cycle));
    expected_W = reference.move_to(circle_W(cycle)).force_W;
  }
  Vector3d force_W = Vector3d::Zero();
  for (int i = 0; i < 20; ++i) {
    finish_whole(object);
    force_W = object.move_to(circle_W(60)).force_W;
  }
  EXPECT_LT((force_W - expected_W).norm(), 1e-3 * expected_W.norm());
  EXPECT_GT(object.whole_solutions(), 0U);
}

// Destroyed and let go of at any moment: TSan and ASan see what is not joined or shared.
TEST(TwoRatesObject, MayLetGoOrEndWhileTheWholeIsBeingSolved) {
  const SpringMesh mesh = little_block();
  for (int round = 0; round < 6; ++round) {
    TwoRatesObject object(mesh, two_rates_options(500.0, {}));
    for (int grip = 0; grip < 3; ++grip) {
      ASSERT_GT(object.grab(Vector3d::Zero(), kPatch_m), 0);
      for (int cycle = 1; cycle <= 5 * (round + 1); ++cycle) {
        ASSERT_TRUE(object.move_to(circle_W(cycle)).force_W.allFinite());
      }
      object.release();
    }
  }
}

TEST(TwoRatesObject, RefusesOptionsThatWouldNotMakeTwoRates) {
  const SpringMesh mesh = little_block();
  EXPECT_THROW(TwoRatesObject(mesh, {.near = {}}), Error);
  EXPECT_THROW(TwoRatesObject(mesh, {.near = {.border_tolerance = 1e-3}}), Error);
  EXPECT_THROW(TwoRatesObject(mesh, {.whole = {.border_tolerance = 1e-3}}), Error);
}

TEST(TwoRatesContact, RefusesAToolThatSlides) {
  ToolOptions tool;
  tool.shape = "sphere";
  tool.contact = "slide";
  EXPECT_THROW(make_two_rates_contact(make_scene("small"), {}, tool), Error);
}

TEST(TwoRatesContact, HoldsAndLetsGoAsAWholeObjectDoes) {
  const Scene scene = make_scene("small");
  const auto two_rates = make_two_rates_contact(scene, two_rates_options(30.0, {}), {});
  const auto whole = make_tool_contact(scene, {}, {});
  const Vector3d top_W = scene.mesh.top_W;
  for (const double height_m : {0.01, 0.005, -0.0005, -0.001, -0.002}) {
    const auto answer = two_rates->step(top_W + Vector3d(0.0, 0.0, height_m));
    const auto expected = whole->step(top_W + Vector3d(0.0, 0.0, height_m));
    ASSERT_EQ(answer.in_contact, expected.in_contact) << height_m;
    EXPECT_EQ(answer.epoch, expected.epoch);
    const double scale_N = std::max(0.05, expected.equilibrium.force_W.norm());
    EXPECT_LT((answer.equilibrium.force_W - expected.equilibrium.force_W).norm(), 0.05 * scale_N);
  }
  EXPECT_TRUE(two_rates->in_contact());
  EXPECT_TRUE(two_rates->report().whole_solutions.has_value());
  EXPECT_FALSE(two_rates->report().reduced.has_value());
  EXPECT_FALSE(whole->report().whole_solutions.has_value());
  two_rates->reset();
  EXPECT_FALSE(two_rates->in_contact());
}

}  // namespace
}  // namespace forcegrid::simulator
