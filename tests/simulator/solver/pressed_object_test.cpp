// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/pressed_object.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "contact/distance.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"

namespace forcegrid::simulator {
namespace {

using contact::ToolShape;
using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kRadius_m = 0.008;

// Linear springs of one stiffness, 5 mm apart, so that symmetry and periodicity hold.
SpringMesh regular_block(double stiffness_N_per_m = 10.0) {
  LatticeBlockOptions options;
  options.vertex_count = {11, 11, 6};
  options.size_m = {0.05, 0.05, 0.025};
  options.stiffness_N_per_m = stiffness_N_per_m;
  options.random_spread = 0.0;
  options.law = {};
  return make_lattice_block(options);
}

PressedObject sphere_on_block(double friction) {
  PressedObject object(regular_block(), ToolShape::sphere(kRadius_m), {.friction = friction});
  object.reset({0.0, 0.0, 0.002});
  return object;
}

// [J] of the force along straight moves through `corners`, by the trapezoid rule; the tool is at
// the first one.
double work_J(PressedObject& object, const std::vector<Vector3d>& corners, double step_m,
              const std::function<void(const Pressed&)>& look = {}) {
  double sum_J = 0.0;
  Pressed before = object.move_to(corners.front());
  for (std::size_t k = 0; k + 1 < corners.size(); ++k) {
    const Vector3d way = corners[k + 1] - corners[k];
    const int steps = static_cast<int>(std::ceil(way.norm() / step_m));
    for (int step = 1; step <= steps; ++step) {
      const Pressed now = object.move_to(corners[k] + way * step / steps);
      sum_J += 0.5 * (before.equilibrium.force_W + now.equilibrium.force_W)
                         .dot(now.position_W - before.position_W);
      if (look) {
        look(now);
      }
      before = now;
    }
  }
  return sum_J;
}

TEST(PressedObject, InTheAirThereIsNoForceAndTheObjectRests) {
  PressedObject object = sphere_on_block(0.3);
  const Pressed state = object.move_to({0.003, 0.001, 0.0005});
  EXPECT_EQ(state.points, 0);
  EXPECT_EQ(state.equilibrium.force_W, Vector3d::Zero());
  EXPECT_TRUE(state.equilibrium.converged);
  EXPECT_NEAR(object.gap_m({0.003, 0.001, 0.0005}, 0.01), 0.0005, 1e-9);
  ASSERT_GT(object.move_to({0.003, 0.001, -0.003}).points, 0);
  object.reset({0.003, 0.001, 0.0005});
  EXPECT_NEAR(object.gap_m({0.003, 0.001, 0.0005}, 0.01), 0.0005, 1e-9) << "at rest again";
}

TEST(PressedObject, AFrictionlessSphereOnAFlatSurfaceFeelsItsNormalAlone) {
  PressedObject object = sphere_on_block(0.0);
  for (const double depth_m : {0.0005, 0.001, 0.002, 0.003}) {
    const Pressed state = object.move_to({0.0, 0.0, -depth_m});
    ASSERT_TRUE(state.equilibrium.converged) << state.equilibrium.relative_residual;
    EXPECT_GT(state.equilibrium.force_W.z(), 0.0);
    // The middle is a symmetric place; the solver's tolerance is 2e-3.
    EXPECT_LT(state.equilibrium.force_W.head<2>().norm(), 4e-3 * state.equilibrium.force_W.z());
    EXPECT_EQ(state.friction_W.norm(), 0.0);
  }
}

TEST(PressedObject, NoVertexStaysInsideTheToolAndTheObjectReturnsToRest) {
  const SpringMesh mesh = regular_block();
  PressedObject object = sphere_on_block(0.3);
  const Vector3d deep_W(0.002, 0.001, -0.003);
  Pressed pressed = object.move_to(deep_W);
  // What one answer's rounds leave over is done in the next.
  for (int again = 0; again < 5 && !pressed.equilibrium.converged; ++again) {
    pressed = object.move_to(deep_W);
  }
  ASSERT_TRUE(pressed.equilibrium.converged);
  EXPECT_LT(pressed.deepest_m, 5e-6);
  const std::vector<Vector3d> positions_W = object.positions_W();
  double lowest_m = 0.0;
  for (std::size_t i = 0; i < positions_W.size(); ++i) {
    EXPECT_GT(contact::locate(object.tool(), deep_W, positions_W[i]).gap_m, -5e-6)
        << "vertex " << i;
    lowest_m = std::min(lowest_m, positions_W[i].z() - mesh.rest_position_W[i].z());
  }
  EXPECT_LT(lowest_m, -0.002);
  const Pressed away = object.move_to({0.002, 0.001, 0.001});
  EXPECT_EQ(away.points, 0);
  EXPECT_EQ(away.equilibrium.force_W, Vector3d::Zero());
  const std::vector<Vector3d> after_W = object.positions_W();
  for (std::size_t i = 0; i < after_W.size(); ++i) {
    EXPECT_LT((after_W[i] - mesh.rest_position_W[i]).norm(), 1e-12);
  }
}

TEST(PressedObject, TheForceIsProportionalToTheSpringsStiffness) {
  PressedObject soft = sphere_on_block(0.0);
  PressedObject stiff(regular_block(25.0), ToolShape::sphere(kRadius_m), {.friction = 0.0});
  stiff.reset({0.0, 0.0, 0.002});
  const Vector3d place_W(0.001, 0.002, -0.002);
  const Pressed a = soft.move_to(place_W);
  const Pressed b = stiff.move_to(place_W);
  ASSERT_TRUE(a.equilibrium.converged && b.equilibrium.converged);
  EXPECT_LT((2.5 * a.equilibrium.force_W - b.equilibrium.force_W).norm(),
            6e-3 * b.equilibrium.force_W.norm());
}

TEST(PressedObject, WithoutFrictionAClosedPathTakesNoWork) {
  PressedObject object(regular_block(), ToolShape::sphere(kRadius_m),
                       {.friction = 0.0, .relative_tolerance = 5e-4});
  object.reset({0.0, 0.0, 0.002});
  double stored_J = 0.0;
  double along_J = 0.0;
  Vector3d last_W(0.001, 0.002, 0.0005);
  Vector3d last_force_W = Vector3d::Zero();
  const double closed_J = work_J(
      object,
      {{0.001, 0.002, 0.0005},
       {0.001, 0.002, -0.003},
       {0.007, 0.005, -0.003},
       {0.007, 0.005, 0.0005},
       {0.001, 0.002, 0.0005}},
      2.5e-4, [&](const Pressed& now) {
        along_J -= 0.5 * (now.equilibrium.force_W + last_force_W).dot(now.position_W - last_W);
        last_W = now.position_W;
        last_force_W = now.equilibrium.force_W;
        stored_J = std::max(stored_J, along_J);
      });
  EXPECT_GT(stored_J, 5e-5);
  EXPECT_LT(std::abs(closed_J), 0.01 * stored_J);
}

TEST(PressedObject, FrictionIsWithinCoulombsBoundAndReachesItInSteadySliding) {
  constexpr double kFriction = 0.3;
  PressedObject object = sphere_on_block(kFriction);
  object.move_to({-0.006, 0.0, 0.0005});
  int steady = 0;
  double ratio_sum = 0.0;
  double lateral_sum_N = 0.0;
  double normal_sum_N = 0.0;
  const double work =
      work_J(object, {{-0.006, 0.0, 0.0005}, {-0.006, 0.0, -0.002}, {0.009, 0.0, -0.002}}, 5e-4,
             [&](const Pressed& now) {
               EXPECT_LE(now.friction_W.norm(), kFriction * now.normal_N * (1.0 + 1e-9));
               // After 5 mm all stick is used up; the next 10 mm are two periods of the lattice.
               if (now.position_W.x() > -0.001 + 1e-9) {
                 ++steady;
                 EXPECT_LT(now.friction_W.x(), 0.0) << "against the motion";
                 ratio_sum += now.friction_W.norm() / (kFriction * now.normal_N);
                 lateral_sum_N -= now.equilibrium.force_W.x();
                 normal_sum_N += now.equilibrium.force_W.z();
               }
             });
  ASSERT_EQ(steady, 20);
  EXPECT_GT(ratio_sum / steady, 0.93) << "mean of friction over its bound";
  EXPECT_NEAR(lateral_sum_N / normal_sum_N, kFriction, 0.15 * kFriction);
  EXPECT_LT(work, 0.0) << "friction takes energy";
}

TEST(PressedObject, TheForceIsContinuousThroughMakingAndBreakingContact) {
  PressedObject object = sphere_on_block(0.3);
  // A step of the tool moves one vertex by no more than itself, and that meets at most what all
  // springs of a vertex are together: 5 along edges, 8 along diagonals.
  constexpr double kStep_m = 1e-4;
  constexpr double kVertex_N_per_m = 5 * 10.0 + 8 * 7.0;
  Vector3d last_W = Vector3d::Zero();
  double most_N = 0.0;
  work_J(object,
         {{0.001, 0.002, 0.0003},
          {0.001, 0.002, -0.0015},
          {0.0025, 0.002, -0.0015},
          {0.0025, 0.002, 0.0003}},
         kStep_m, [&](const Pressed& now) {
           const double jump_N = (now.equilibrium.force_W - last_W).norm();
           EXPECT_LT(jump_N, kVertex_N_per_m * kStep_m) << "at " << now.position_W.transpose();
           last_W = now.equilibrium.force_W;
           most_N = std::max(most_N, last_W.norm());
         });
  EXPECT_GT(most_N, 0.03);
  EXPECT_EQ(last_W, Vector3d::Zero());
}

TEST(PressedObject, ItsStiffnessIsTheForcesDerivativeWithoutFriction) {
  PressedObject object(regular_block(), ToolShape::sphere(kRadius_m),
                       {.friction = 0.0, .relative_tolerance = 1e-4});
  object.reset({0.0, 0.0, 0.002});
  const Vector3d place_W(0.001, 0.0005, -0.0025);
  object.move_to(place_W);
  const Pressed state = object.move_to(place_W);
  ASSERT_TRUE(state.stiffness_known);
  constexpr double kStep_m = 2e-5;
  Eigen::Matrix3d difference;
  for (int c = 0; c < 3; ++c) {
    const Vector3d step = kStep_m * Vector3d::Unit(c);
    const Vector3d ahead_W = object.move_to(place_W + step).equilibrium.force_W;
    const Vector3d behind_W = object.move_to(place_W - step).equilibrium.force_W;
    difference.col(c) = (ahead_W - behind_W) / (2.0 * kStep_m);
  }
  EXPECT_LT(difference(2, 2), 0.0);
  EXPECT_LT((difference - state.equilibrium.stiffness_W).norm(), 0.1 * difference.norm())
      << difference << "\n"
      << state.equilibrium.stiffness_W;
}

TEST(PressedObject, AGrasperHoldsWhatIsBetweenItsJawsUntilTheyOpen) {
  PressedObject object(regular_block(), ToolShape::grasper(0.002, 0.02, 0.8), {.friction = 0.3});
  object.reset({0.0, 0.0, 0.003});
  const Pressed open = object.move_to({0.0, 0.0, -0.004});
  const int held = object.grasp();
  EXPECT_GT(held, 0);
  const Pressed closed = object.move_to({0.0, 0.0, -0.004});
  EXPECT_EQ(closed.held, held);
  EXPECT_LT((closed.equilibrium.force_W - open.equilibrium.force_W).norm(),
            0.01 + 0.02 * open.equilibrium.force_W.norm())
      << "closing changes no force";
  Pressed pulled;
  for (int step = 1; step <= 10; ++step) {
    pulled = object.move_to({0.0, 0.0, -0.004 + 0.001 * step});
  }
  EXPECT_EQ(pulled.held, held);
  EXPECT_LT(pulled.equilibrium.force_W.z(), -0.05) << "it pulls the tissue up";
  object.let_go();
  const Pressed free = object.move_to({0.0, 0.0, 0.008});
  EXPECT_EQ(free.points, 0);
  EXPECT_EQ(free.equilibrium.force_W, Vector3d::Zero());
}

TEST(PressedObject, OnlyAGrasperGrasps) {
  PressedObject object = sphere_on_block(0.3);
  object.move_to({0.0, 0.0, -0.002});
  EXPECT_EQ(object.grasp(), 0);
}

TEST(PressedObject, AMoveThatIsTooLongEndsOnTheWayAndSaysSo) {
  PressOptions options;
  options.max_steps = 2;
  options.max_step_m = 5e-4;
  PressedObject object(regular_block(), ToolShape::sphere(kRadius_m), options);
  object.reset({0.0, 0.0, 0.002});
  const Pressed state = object.move_to({0.0, 0.0, -0.004});
  EXPECT_FALSE(state.equilibrium.reached);
  EXPECT_LT(state.position_W.z(), 0.0);
  EXPECT_GT(state.position_W.z(), -0.0025);
  EXPECT_TRUE(object.move_to(state.position_W).equilibrium.reached);
}

TEST(PressedObject, APositionThatIsNotFiniteChangesNothing) {
  PressedObject object = sphere_on_block(0.3);
  const Pressed before = object.move_to({0.0, 0.0, -0.002});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Pressed after = object.move_to({0.0, nan, 0.0});
  EXPECT_FALSE(after.equilibrium.converged);
  EXPECT_FALSE(after.equilibrium.reached);
  EXPECT_EQ(after.equilibrium.force_W, before.equilibrium.force_W);
  EXPECT_EQ(after.position_W, before.position_W);
}

TEST(PressedObject, RefusesOptionsOutOfRangeByName) {
  const SpringMesh mesh = regular_block();
  const auto message = [&mesh](const PressOptions& options) -> std::string {
    try {
      PressedObject(mesh, ToolShape::sphere(kRadius_m), options);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(message({.friction = -0.1}), HasSubstr("friction"));
  EXPECT_THAT(message({.stick_m = 0.0}), HasSubstr("stick_m"));
  EXPECT_THAT(message({.point_spacing_m = -1.0}), HasSubstr("point_spacing_m"));
  EXPECT_THAT(message({.relative_tolerance = 0.0}), HasSubstr("relative_tolerance"));
  EXPECT_THAT(message({.max_steps = 0}), HasSubstr("max_steps"));
  SpringMesh bare = mesh;
  bare.triangles.clear();
  EXPECT_THROW(PressedObject(bare, ToolShape::sphere(kRadius_m)), Error);
}

// Hertz: the force of a sphere on an elastic half-space grows as depth^1.5. On springs 2.5 mm apart
// that holds while the contact's radius, sqrt(R depth), is a few of them wide and far from the
// edges.
TEST(PressedObject, AShallowIndentationGrowsAsHertzSays) {
  LatticeBlockOptions options;
  options.vertex_count = {21, 21, 13};
  options.size_m = {0.05, 0.05, 0.03};
  options.random_spread = 0.0;
  options.law = {};
  PressedObject object(make_lattice_block(options), ToolShape::sphere(0.03), {.friction = 0.0});
  object.reset({0.0, 0.0, 0.001});
  const Pressed shallow = object.move_to({0.0, 0.0, -0.0007});
  const Pressed deep = object.move_to({0.0, 0.0, -0.0021});
  ASSERT_TRUE(shallow.equilibrium.converged && deep.equilibrium.converged);
  const double exponent =
      std::log(deep.equilibrium.force_W.z() / shallow.equilibrium.force_W.z()) / std::log(3.0);
  EXPECT_NEAR(exponent, 1.5, 0.2);
}

}  // namespace
}  // namespace forcegrid::simulator
