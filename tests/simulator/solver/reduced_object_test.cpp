// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/reduced_object.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::Contains;
using ::testing::HasSubstr;

constexpr double kPatch_m = 0.013;

SpringMesh block() {
  LatticeBlockOptions options;
  options.vertex_count = {8, 8, 7};
  return make_lattice_block(options);
}

// 6 mm around (0, 0, 6) mm, never twice the same way.
Vector3d place_W(int k) {
  const double t = 0.05 * k;
  return 1e-3 * Vector3d(6.0 * std::sin(1.1 * t), 6.0 * std::sin(1.7 * t + 0.4),
                         6.0 - 6.0 * std::cos(0.9 * t));
}

ReducedObjectOptions in_place() {
  ReducedObjectOptions options;
  options.first_states = 20;
  options.own_threads = false;
  return options;
}

int moves_until_in_use(ReducedObject& object, int from = 1) {
  for (int k = from; k < from + 2000; ++k) {
    object.move_to(place_W(k));
    if (object.use().in_use) {
      return k;
    }
  }
  ADD_FAILURE() << "no model was ever used";
  return from + 2000;
}

TEST(ReducedObject, LearnsAndThenAnswersNearlyAsTheConvergedObject) {
  const SpringMesh mesh = block();
  std::vector<std::string> messages;
  ReducedObjectOptions options = in_place();
  options.say = [&messages](const std::string& what) { messages.push_back(what); };
  ReducedObject object(mesh, options);
  ElasticObject<double> converged(mesh, {.relative_tolerance = 1e-6});
  ASSERT_EQ(object.grab(mesh.top_W, kPatch_m), converged.grab(mesh.top_W, kPatch_m));
  double error2_N2 = 0.0;
  double all2_N2 = 0.0;
  int models = 0;
  for (int k = 1; k <= 1000; ++k) {
    const Equilibrium answer = object.move_to(place_W(k));
    const Vector3d expected_W = converged.move_to(place_W(k)).force_W;
    EXPECT_TRUE(answer.converged && answer.reached) << k;
    EXPECT_EQ(answer.displacement_W, place_W(k));
    error2_N2 += (answer.force_W - expected_W).squaredNorm();
    all2_N2 += expected_W.squaredNorm();
    models += object.use().in_use ? 1 : 0;
  }
  EXPECT_GT(models, 500);
  EXPECT_EQ(object.use().answers, static_cast<std::uint64_t>(models));
  EXPECT_EQ(object.use().answers + object.use().full_answers, 1000U);
  EXPECT_LT(std::sqrt(error2_N2 / all2_N2), 3e-3);
  EXPECT_LT(object.use().springs, mesh.springs.size() / 5);
  EXPECT_GT(object.use().checks, static_cast<std::uint64_t>(options.passes));
  EXPECT_THAT(messages, Contains(HasSubstr("in use")));
}

TEST(ReducedObject, WithTheFullObjectOnAnotherThreadItAnswersTheSame) {
  const SpringMesh mesh = block();
  ReducedObjectOptions options = in_place();
  options.own_threads = true;
  ReducedObject object(mesh, options);
  ElasticObject<double> converged(mesh, {.relative_tolerance = 1e-6});
  object.grab(mesh.top_W, kPatch_m);
  converged.grab(mesh.top_W, kPatch_m);
  int k = 1;
  for (; k < 20'000 && object.use().answers < 300; ++k) {
    const Equilibrium answer = object.move_to(place_W(k));
    if (object.use().in_use && object.use().answers % 10 == 0) {
      converged.move_to(place_W(k - 1));
      const Vector3d expected_W = converged.move_to(place_W(k)).force_W;
      EXPECT_LT((answer.force_W - expected_W).norm(), 0.02 * std::max(expected_W.norm(), 0.5)) << k;
    }
  }
  EXPECT_GE(object.use().answers, 300U) << "after " << k << " moves";
}

TEST(ReducedObject, PositionsWithAModelAreNearlyTheFullObjectsAndThePatchIsExact) {
  const SpringMesh mesh = block();
  ReducedObject object(mesh, in_place());
  ElasticObject<double> converged(mesh, {.relative_tolerance = 1e-6});
  object.grab(mesh.top_W, kPatch_m);
  converged.grab(mesh.top_W, kPatch_m);
  std::vector<std::int32_t> all(mesh.rest_position_W.size());
  std::iota(all.begin(), all.end(), 0);
  std::vector<Vector3d> position_W;
  int models = 0;
  int k = 1;
  for (; k < 2000 && models < 50; ++k) {
    object.move_to(place_W(k));
    object.copy_positions(all, position_W);
    converged.move_to(place_W(k));
    if (!object.use().in_use) {
      continue;
    }
    ++models;
    const std::vector<Vector3d> expected_W = converged.positions_W();
    double worst_m = 0.0;
    for (std::size_t i = 0; i < expected_W.size(); ++i) {
      worst_m = std::max(worst_m, (position_W[i] - expected_W[i]).norm());
    }
    // A move is 0.5 mm long. What S leaves of it is of second order.
    EXPECT_LT(worst_m, 0.03e-3) << k;
    for (const std::int32_t held : converged.patch()) {
      const auto i = static_cast<std::size_t>(held);
      EXPECT_LT((position_W[i] - mesh.rest_position_W[i] - place_W(k)).norm(), 1e-6) << k;
    }
  }
  EXPECT_EQ(models, 50) << "after " << k << " moves";
}

TEST(ReducedObject, AToolThatKeepsToALineIsEnoughToLearnFrom) {
  const SpringMesh mesh = block();
  ReducedObject object(mesh, in_place());
  object.grab(mesh.top_W, kPatch_m);
  for (int k = 1; k <= 400; ++k) {
    object.move_to({0.0, 0.0, 0.006 - 0.006 * std::cos(0.1 * k)});
  }
  EXPECT_LT(object.use().states, in_place().first_states);
  EXPECT_GT(object.use().answers, 200U);
}

TEST(ReducedObject, IsNotUsedWhereItsForceIsNotGoodEnough) {
  const SpringMesh mesh = block();
  std::vector<std::string> messages;
  ReducedObjectOptions options = in_place();
  options.check_tolerance = 1e-9;
  options.training.most_modes = 6;
  options.say = [&messages](const std::string& what) { messages.push_back(what); };
  ReducedObject object(mesh, options);
  object.grab(mesh.top_W, kPatch_m);
  for (int k = 1; k <= 200; ++k) {
    object.move_to(place_W(k));
  }
  EXPECT_GT(object.use().trainings, 0U);
  EXPECT_GT(object.use().failed_checks, 10U);
  EXPECT_EQ(object.use().answers, 0U);
  EXPECT_EQ(object.use().full_answers, 200U);
}

// One mode that is trusted after one check, and then found out.
TEST(ReducedObject, AModelInUseThatFailsACheckIsDroppedAloud) {
  const SpringMesh mesh = block();
  std::vector<std::string> messages;
  ReducedObjectOptions options = in_place();
  options.training.most_modes = 1;
  options.check_tolerance = 1e-3;
  options.passes = 1;
  options.passes_again = 1000;
  options.say = [&messages](const std::string& what) { messages.push_back(what); };
  ReducedObject object(mesh, options);
  object.grab(mesh.top_W, kPatch_m);
  for (int k = 1; k <= 1000 && messages.size() < 2; ++k) {
    object.move_to(place_W(k));
  }
  EXPECT_THAT(messages, Contains(HasSubstr("the full object answers")));
  EXPECT_FALSE(object.use().in_use);
  EXPECT_GT(object.use().worst_check, options.check_tolerance);
}

TEST(ReducedObject, OutOfReachTheFullObjectAnswers) {
  const SpringMesh mesh = block();
  ReducedObject object(mesh, in_place());
  ElasticObject<double> converged(mesh, {.relative_tolerance = 1e-6});
  object.grab(mesh.top_W, kPatch_m);
  converged.grab(mesh.top_W, kPatch_m);
  moves_until_in_use(object);
  const Vector3d far_W(0.0, 0.0, 0.024);
  const Equilibrium answer = object.move_to(far_W);
  EXPECT_FALSE(object.use().in_use);
  EXPECT_EQ(object.use().out_of_reach, 1U);
  const Vector3d expected_W = converged.move_to(far_W).force_W;
  EXPECT_LT((answer.force_W - expected_W).norm(), 1e-3 * expected_W.norm());
}

TEST(ReducedObject, TheNextGrabKnowsNothingOfTheLast) {
  const SpringMesh mesh = block();
  ReducedObject object(mesh, in_place());
  object.grab(mesh.top_W, kPatch_m);
  moves_until_in_use(object);
  object.release();
  EXPECT_EQ(object.move_to({0.0, 0.0, 0.005}).force_W, Vector3d::Zero());
  const Vector3d beside_W = mesh.top_W + Vector3d(0.02, 0.0, 0.0);
  ASSERT_GT(object.grab(beside_W, kPatch_m), 0);
  const std::uint64_t models = object.use().answers;
  object.move_to(place_W(1));
  EXPECT_EQ(object.use().answers, models);
  EXPECT_FALSE(object.use().in_use);
  moves_until_in_use(object, 2);
}

TEST(ReducedObject, CanBeReleasedAndDestroyedWhileItLearns) {
  const SpringMesh mesh = block();
  for (int round = 0; round < 3; ++round) {
    ReducedObjectOptions options;
    options.first_states = 5;
    ReducedObject object(mesh, options);
    object.grab(mesh.top_W, kPatch_m);
    for (int k = 1; k <= 40 + 20 * round; ++k) {
      object.move_to(place_W(k));
    }
    if (round == 1) {
      object.release();
    }
  }
}

TEST(ReducedObject, SaysWhenTheFullObjectLeftItsBranchAndBeginsAnew) {
  const Scene scene = make_scene("small");
  ReducedObjectOptions options = in_place();
  options.reach_m = 1.0;  // the model answers as far as the object goes
  options.check_tolerance = 1e3;
  ReducedObject object(scene.mesh, options);
  object.grab(scene.mesh.top_W, scene.patch_radius_m);
  moves_until_in_use(object);
  bool left_branch = false;
  bool in_use = true;
  for (int i = 1; i <= 60 && !left_branch; ++i) {
    left_branch = object.move_to({0.0002 * i, 0.0, -0.001 * i}).left_branch;
    in_use = object.use().in_use;
  }
  EXPECT_TRUE(left_branch) << "a deep push should snap through";
  EXPECT_FALSE(in_use);
}

TEST(ReducedObject, WithoutAGrabOrAPlaceNothingMoves) {
  ReducedObject object(block(), in_place());
  EXPECT_EQ(object.move_to({0.0, 0.0, 0.01}).force_W, Vector3d::Zero());
  object.grab(Vector3d::Zero(), kPatch_m);
  const int k = moves_until_in_use(object);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Equilibrium lost = object.move_to({nan, 0.0, 0.0});
  EXPECT_FALSE(lost.converged);
  EXPECT_FALSE(lost.reached);
  EXPECT_TRUE(lost.force_W.allFinite());
  EXPECT_TRUE(object.move_to(place_W(k + 1)).converged);
}

TEST(ReducedObject, RefusesOptionsOutOfRangeByName) {
  const auto message = [](auto change) -> std::string {
    ReducedObjectOptions options;
    change(options);
    try {
      ReducedObject object(block(), options);
      return "nothing was thrown";
    } catch (const Error& error) {
      return error.what();
    }
  };
  EXPECT_THAT(message([](auto& o) { o.check_tolerance = 0.0; }), HasSubstr("check_tolerance"));
  EXPECT_THAT(message([](auto& o) { o.reach_m = -1.0; }), HasSubstr("reach_m"));
  EXPECT_THAT(message([](auto& o) { o.check_every = 0; }), HasSubstr("check_every"));
  EXPECT_THAT(message([](auto& o) { o.first_states = 81; }), HasSubstr("first_states is 81"));
  EXPECT_THAT(message([](auto& o) { o.patience = 0; }), HasSubstr("patience"));
  EXPECT_THAT(message([](auto& o) { o.training.most_modes = 99; }), HasSubstr("most_modes"));
}

}  // namespace
}  // namespace forcegrid::simulator
