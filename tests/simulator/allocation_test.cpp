// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/pressed_object.h"
#include "simulator/solver/reduced_training.h"
#include "simulator/solver/shared_object.h"
#include "simulator/solver/two_rates_object.h"
#include "tests/support/allocation_count.h"

namespace forcegrid::simulator {
namespace {

TEST(ElasticObject, MovesDoNotAllocateEvenWhenTheObjectSnapsThrough) {
  ElasticObject<float> object(make_scene("small").mesh);
  object.grab(Eigen::Vector3d::Zero(), 0.012);
  bool left_branch = false;
  const testing::AllocationCount count;
  for (int i = 1; i <= 40; ++i) {
    left_branch |= object.move_to({0.0002 * i, 0, -0.001 * i}).left_branch;
  }
  EXPECT_EQ(count.value(), 0U);
  EXPECT_TRUE(left_branch) << "the way out of an unstable state was not exercised";
}

TEST(SharedObject, MovesOfTwoToolsDoNotAllocate) {
  SharedObject<float> object(make_scene("small").mesh, {}, 2);
  ASSERT_GT(object.grab(0, {-0.02, 0, 0}, 0.012), 0);
  ASSERT_GT(object.grab(1, {0.02, 0, 0}, 0.012), 0);
  const testing::AllocationCount count;
  for (int i = 1; i <= 20; ++i) {
    object.aim(0, {0.0002 * i, 0, -0.001 * i});
    object.aim(1, {0, 0.0003 * i, 0.0005 * i});
    object.solve();
  }
  EXPECT_EQ(count.value(), 0U);
}

TEST(TwoRatesObject, MovesDoNotAllocateNorDoesTakingTheWholeIn) {
  TwoRatesObject object(
      make_scene("small").mesh,
      {.near = {.border_tolerance = 1e-3, .most_vertices = 300}, .own_thread = false});
  object.grab(Eigen::Vector3d::Zero(), 0.012);
  object.solve_whole();  // takes hold, which allocates
  object.hand_over();
  const testing::AllocationCount count;
  for (int i = 1; i <= 20; ++i) {
    object.move_to({0.0002 * i, 0, 0.0003 * i});
    object.solve_whole();
    object.hand_over();
  }
  EXPECT_EQ(count.value(), 0U);
  EXPECT_EQ(object.whole_solutions(), 19U);
}

TEST(PressedObject, NeitherMovesNorTheGraspersJawsAllocate) {
  PressedObject object(make_scene("small").mesh, contact::ToolShape::grasper(0.004, 0.03, 0.8));
  object.reset({0.0, 0.0, 0.001});
  int points = 0;
  int held = 0;
  const testing::AllocationCount count;
  for (int i = 1; i <= 6; ++i) {
    points += object.move_to({0.0005 * i, 0.0, -0.001 * i}).points;
  }
  held = object.grasp();
  object.move_to({0.0, 0.0, -0.002});
  object.let_go();
  object.move_to({0.0, 0.0, -0.002});
  EXPECT_EQ(count.value(), 0U);
  EXPECT_GT(points, 0);
  EXPECT_GT(held, 0);
}

TEST(ReducedModel, MovesDoNotAllocateWithMostModesEither) {
  const SpringMesh mesh = make_scene("small").mesh;
  ElasticObject<float> full(mesh);
  full.grab(Eigen::Vector3d::Zero(), 0.012);
  ReducedTrainingSet set = begin_training_set(mesh, full);
  for (int i = 1; i <= 60; ++i) {
    const Eigen::Vector3d place_W(0.008 * std::sin(0.7 * i), 0.008 * std::cos(0.4 * i), 0.0003 * i);
    add_state(mesh, full, full.move_to(place_W), {}, set);
  }
  const ReducedTraining training = train_reduced_model(
      mesh, set, {.mode_tolerance = 1e-12, .most_modes = kMostReducedCoordinates - 3});
  ReducedModel model = *training.model;
  EXPECT_GT(model.modes(), 30) << "Eigen's larger kernels were not exercised";
  bool converged = true;
  const testing::AllocationCount count;
  for (int i = 1; i <= 60; ++i) {
    converged &= model.move_to({0.0001 * i, 0.0, 0.0002 * i}).converged;
  }
  EXPECT_EQ(count.value(), 0U);
  EXPECT_TRUE(converged);
}

TEST(ElasticObject, TheCountSeesTheAllocationsOfPositions) {
  ElasticObject<float> object(make_scene("small").mesh);
  const testing::AllocationCount count;
  EXPECT_FALSE(object.positions_W().empty());
  EXPECT_GT(count.value(), 0U);
}

}  // namespace
}  // namespace forcegrid::simulator
