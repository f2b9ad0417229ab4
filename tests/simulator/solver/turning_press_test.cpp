// SPDX-License-Identifier: Apache-2.0
// PressedObject under a tool that turns: what it presses on, its torque, and a twisting grasp.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "reference_springs.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/solver/pressed_object.h"

namespace forcegrid::simulator {
namespace {

using contact::ToolShape;
using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

SpringMesh regular_block() {
  LatticeBlockOptions options;
  options.vertex_count = {11, 11, 6};
  options.size_m = {0.05, 0.05, 0.025};
  options.stiffness_N_per_m = 10.0;
  options.random_spread = 0.0;
  options.law = {};
  return make_lattice_block(options);
}

PressOptions tight(double friction) {
  PressOptions options;
  options.friction = friction;
  options.relative_tolerance = 1e-5;
  options.max_rounds = 400;
  options.max_iterations = 8000;
  return options;
}

Quaterniond about(const Vector3d& axis, double angle_rad) {
  return Quaterniond(AngleAxisd(angle_rad, axis));
}

TEST(TurningPress, ATiltedRodPressesAsOneThatWasMadeTilted) {
  const SpringMesh mesh = regular_block();
  const Quaterniond tilted_WT = about(Vector3d::UnitY(), 0.6);
  PressedObject turned(mesh, ToolShape::capsule(0.003, 0.02), tight(0.3));
  PressedObject made(mesh, ToolShape::capsule(0.003, 0.02, tilted_WT * Vector3d(0.0, 0.0, 1.0)),
                     tight(0.3));
  turned.reset({7e-4, 1.1e-3, 0.004}, tilted_WT);
  made.reset({7e-4, 1.1e-3, 0.004});
  for (int step = 0; step <= 10; ++step) {
    const Vector3d position_W(7e-4 + 2e-4 * step, 1.1e-3, 0.002 - 4e-4 * step);
    const Pressed found = turned.move_to(position_W, tilted_WT);
    const Pressed expected = made.move_to(position_W);
    EXPECT_EQ(found.points, expected.points) << step;
    EXPECT_LE((found.equilibrium.force_W - expected.equilibrium.force_W).norm(),
              1e-4 * (expected.equilibrium.force_W.norm() + 0.01))
        << step;
  }
}

TEST(TurningPress, WithoutATurnEveryDigitIsTheOldOne) {
  const SpringMesh mesh = regular_block();
  PressedObject plain(mesh, ToolShape::capsule(0.003, 0.02), {.friction = 0.3});
  PressedObject turning(mesh, ToolShape::capsule(0.003, 0.02), {.friction = 0.3});
  plain.reset({0.0, 0.0, 0.002});
  turning.reset({0.0, 0.0, 0.002}, Quaterniond::Identity());
  for (int step = 0; step <= 10; ++step) {
    const Vector3d position_W(3e-4 * step, 1e-4 * step, 0.001 - 4e-4 * step);
    const Pressed expected = plain.move_to(position_W);
    const Pressed found = turning.move_to(position_W, Quaterniond::Identity());
    EXPECT_EQ(found.equilibrium.force_W, expected.equilibrium.force_W) << step;
    EXPECT_EQ(found.equilibrium.stiffness_W, expected.equilibrium.stiffness_W) << step;
  }
}

// Without friction each force on a sphere goes through its centre, and each on a rod through its
// axis.
TEST(TurningPress, TheTorqueOfARoundToolWithoutFrictionIsThatOfItsForceAtTheCentre) {
  constexpr double kRadius_m = 0.006;
  const Quaterniond tilted_WT = about(Vector3d(0.6, 0.8, 0.0), 0.5);
  PressedObject sphere(regular_block(), ToolShape::sphere(kRadius_m), tight(0.0));
  sphere.reset({0.001, 0.0, 0.005}, tilted_WT);
  const Pressed pressed = sphere.move_to({0.001, 0.0, -0.003}, tilted_WT);
  ASSERT_TRUE(pressed.equilibrium.torque_known);
  ASSERT_GT(pressed.equilibrium.force_W.z(), 0.05);
  const Vector3d centre_W = tilted_WT * Vector3d(0.0, 0.0, kRadius_m);
  const Vector3d expected_Nm = centre_W.cross(pressed.equilibrium.force_W);
  // A point may be as deep inside as the tolerance leaves it.
  EXPECT_LE((pressed.equilibrium.torque_W_Nm - expected_Nm).norm(), 1e-4 * expected_Nm.norm());

  PressedObject rod(regular_block(), ToolShape::blade(0.003, 0.02), tight(0.0));
  const Quaterniond oblique_WT = about(Vector3d::UnitZ(), 0.4) * about(Vector3d::UnitY(), 0.15);
  rod.reset({0.001, 0.0, 0.006}, oblique_WT);
  const Pressed on_edge = rod.move_to({0.001, 0.0, -0.002}, oblique_WT);
  ASSERT_GT(on_edge.equilibrium.torque_W_Nm.norm(), 1e-4);
  const Vector3d along_W = oblique_WT * Vector3d(1.0, 0.0, 0.0);
  const Vector3d about_axis_Nm =
      on_edge.equilibrium.torque_W_Nm -
      Vector3d(oblique_WT * Vector3d(0.0, 0.0, 0.003)).cross(on_edge.equilibrium.force_W);
  EXPECT_NEAR(about_axis_Nm.dot(along_W), 0.0, 1e-4 * on_edge.equilibrium.torque_W_Nm.norm());
}

/// A grasper that has closed on the block's surface.
class TwistingGrasp : public ::testing::Test {
 protected:
  TwistingGrasp() : object_(mesh_, ToolShape::grasper(0.002, 0.02, 0.8), tight(0.0)) {
    object_.reset({0.0, 0.0, 0.003}, Quaterniond::Identity());
    object_.move_to(place_W_);
    EXPECT_GT(object_.grasp(), 3);
  }

  Pressed turned_to(double angle_rad) {
    Pressed found;
    for (int again = 0; again < 10; ++again) {  // what one answer leaves over is done in the next
      found = object_.move_to(place_W_, about(Vector3d::UnitZ(), angle_rad));
      if (found.equilibrium.converged) {
        break;
      }
    }
    EXPECT_TRUE(found.equilibrium.converged && found.equilibrium.reached) << angle_rad;
    return found;
  }

  const Vector3d place_W_{0.0, 0.0, -0.004};
  SpringMesh mesh_ = regular_block();
  PressedObject object_;
};

TEST_F(TwistingGrasp, TurnsTheToolBackAndTheGroundTheOtherWay) {
  const double at_first_Nm = turned_to(0.0).equilibrium.torque_W_Nm.z();
  double before_Nm = at_first_Nm;
  for (const double angle_rad : {0.1, 0.2, 0.4}) {
    const Pressed twisted = turned_to(angle_rad);
    EXPECT_LT(twisted.equilibrium.torque_W_Nm.z(), before_Nm) << angle_rad;
    before_Nm = twisted.equilibrium.torque_W_Nm.z();
    const std::vector<Vector3d> x_W = object_.positions_W();
    const std::vector<Vector3d> force_W = ::forcegrid::simulator::testing::forces_W(mesh_, x_W);
    Vector3d on_ground_Nm = Vector3d::Zero();
    for (std::size_t i = 0; i < x_W.size(); ++i) {
      if (mesh_.fixed[i] != 0) {
        on_ground_Nm += (x_W[i] - place_W_).cross(force_W[i]);
      }
    }
    EXPECT_LE((twisted.equilibrium.torque_W_Nm + on_ground_Nm).norm(), 2e-3 * on_ground_Nm.norm());
  }
  const Pressed back = turned_to(0.0);
  EXPECT_NEAR(back.equilibrium.torque_W_Nm.z(), at_first_Nm, 0.01 * std::abs(before_Nm));
}

TEST_F(TwistingGrasp, HasTheTorqueThatTheEnergyIsSpentOn) {
  constexpr double kStep_rad = 0.02;
  for (const double angle_rad : {0.15, 0.3}) {
    const auto energy_J = [&](double at_rad) {
      turned_to(at_rad);
      return ::forcegrid::simulator::testing::energy_J(mesh_, object_.positions_W());
    };
    const double before_J = energy_J(angle_rad - kStep_rad);
    const double torque_Nm = turned_to(angle_rad).equilibrium.torque_W_Nm.z();
    const double after_J = energy_J(angle_rad + kStep_rad);
    const double slope_Nm = (after_J - before_J) / (2.0 * kStep_rad);
    EXPECT_NEAR(torque_Nm, -slope_Nm, 0.01 * slope_Nm) << angle_rad;
  }
}

// Central differences of the torque about an axis, beside the solver's own derivative.
void expect_the_derivative_of_the_torque(PressedObject& object, const Vector3d& position_W,
                                         const Quaterniond& orientation_WT) {
  const auto pressed_at = [&](const Vector3d& shift_W, const Quaterniond& turn_W) {
    Pressed found;
    for (int again = 0; again < 10; ++again) {
      found = object.move_to(position_W + shift_W, turn_W * orientation_WT);
      if (found.equilibrium.converged) {
        break;
      }
    }
    EXPECT_TRUE(found.equilibrium.converged);
    return found.equilibrium;
  };
  const auto at = [&](const Quaterniond& turn_W) { return pressed_at(Vector3d::Zero(), turn_W); };
  constexpr double kStep_rad = 2e-3;
  constexpr double kStep_m = 2e-5;
  Eigen::Matrix3d differences;
  Eigen::Matrix3d by_place_N;
  for (int axis = 0; axis < 3; ++axis) {
    const auto shifted_Nm = [&](double step_m) {
      return pressed_at(step_m * Vector3d::Unit(axis), Quaterniond::Identity()).torque_W_Nm;
    };
    by_place_N.col(axis) = (shifted_Nm(kStep_m) - shifted_Nm(-kStep_m)) / (2.0 * kStep_m);
    const Vector3d ahead_Nm = at(about(Vector3d::Unit(axis), kStep_rad)).torque_W_Nm;
    const Vector3d behind_Nm = at(about(Vector3d::Unit(axis), -kStep_rad)).torque_W_Nm;
    differences.col(axis) = (ahead_Nm - behind_Nm) / (2.0 * kStep_rad);
  }
  const Equilibrium here = at(Quaterniond::Identity());
  ASSERT_TRUE(here.rotational_stiffness_known);
  // As of dF/dP: points come and go within the step.
  EXPECT_LE((here.rotational_stiffness_W_Nm_per_rad - differences).norm(), 0.1 * differences.norm())
      << here.rotational_stiffness_W_Nm_per_rad << "\nby differences\n"
      << differences;
  EXPECT_LE((here.torque_gradient_W_N - by_place_N).norm(), 0.1 * by_place_N.norm())
      << here.torque_gradient_W_N << "\nby differences\n"
      << by_place_N;
}

TEST(TurningPress, HasTheDerivativeOfTheTorqueOfABladeThatPresses) {
  PressOptions options = tight(0.0);
  options.rotational_stiffness = true;
  PressedObject blade(regular_block(), ToolShape::blade(0.003, 0.02), options);
  const Quaterniond oblique_WT = about(Vector3d::UnitZ(), 0.4) * about(Vector3d::UnitY(), 0.1);
  blade.reset({0.001, 0.0007, 0.006}, oblique_WT);
  blade.move_to({0.001, 0.0007, -0.002}, oblique_WT);
  expect_the_derivative_of_the_torque(blade, {0.001, 0.0007, -0.002}, oblique_WT);
}

TEST(TurningPress, HasTheDerivativeOfTheTorqueOfAGraspThatIsTwisted) {
  PressOptions options = tight(0.0);
  options.rotational_stiffness = true;
  PressedObject grasper(regular_block(), ToolShape::grasper(0.002, 0.02, 0.8), options);
  grasper.reset({0.0, 0.0, 0.003}, Quaterniond::Identity());
  grasper.move_to({0.0, 0.0, -0.004});
  ASSERT_GT(grasper.grasp(), 3);
  grasper.move_to({0.0, 0.0, 0.0}, about(Vector3d::UnitZ(), 0.2));
  expect_the_derivative_of_the_torque(grasper, {0.0, 0.0, 0.0}, about(Vector3d::UnitZ(), 0.2));
}

TEST(TurningPress, ATurnThatIsNotFiniteKeepsTheAnswer) {
  PressedObject object(regular_block(), ToolShape::sphere(0.006), {.friction = 0.3});
  object.reset({0.0, 0.0, 0.002});
  const Pressed before = object.move_to({0.0, 0.0, -0.002});
  const Pressed after = object.move_to(
      {0.0, 0.0, -0.003}, Quaterniond(std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0, 0.0));
  EXPECT_FALSE(after.equilibrium.converged);
  EXPECT_FALSE(after.equilibrium.reached);
  EXPECT_EQ(after.equilibrium.force_W, before.equilibrium.force_W);
}

}  // namespace
}  // namespace forcegrid::simulator
