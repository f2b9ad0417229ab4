// SPDX-License-Identifier: Apache-2.0
// ElasticObject under a tool that turns: torque and rotational stiffness.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "reference_springs.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/turning_sensitivities.h"

namespace forcegrid::simulator {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kPatchRadius_m = 0.012;

SpringMesh block_with(double cubic) {
  LatticeBlockOptions options;
  options.vertex_count = {6, 7, 5};
  options.size_m = {0.05, 0.06, 0.04};
  options.law.cubic_coefficient = cubic;
  return make_lattice_block(options);
}

SolverOptions to_the_last_digits() {
  SolverOptions options;
  options.relative_tolerance = 1e-10;
  options.sensitivity_tolerance = 1e-5;  // S and T are single precision
  options.max_iterations = 4000;
  return options;
}

// Two held vertices at x = +-a, each pulled by two springs in series toward a fixed vertex, which
// lies b beside it along -+y. A turn about z stretches both alike.
struct PairOnSprings {
  static constexpr double kArm_m = 0.01;
  static constexpr double kLength_m = 0.05;
  static constexpr double kFirst_N_per_m = 60.0;
  static constexpr double kSecond_N_per_m = 20.0;

  static SpringMesh mesh() {
    SpringMesh mesh;
    mesh.laws = {{.cubic_coefficient = 0.0}};
    for (const double side : {1.0, -1.0}) {
      const auto first = static_cast<std::int32_t>(mesh.rest_position_W.size());
      for (const double part : {0.0, 0.4, 1.0}) {
        mesh.rest_position_W.emplace_back(side * kArm_m, -side * part * kLength_m, 0.0);
        mesh.fixed.push_back(part == 1.0 ? 1 : 0);
      }
      mesh.springs.push_back({first, first + 1, kFirst_N_per_m});
      mesh.springs.push_back({first + 1, first + 2, kSecond_N_per_m});
    }
    return mesh;
  }

  // [N m] About z, from the geometry of one spring of k1 k2 / (k1 + k2).
  static double torque_Nm(double angle_rad) {
    const double k = kFirst_N_per_m * kSecond_N_per_m / (kFirst_N_per_m + kSecond_N_per_m);
    const double x = kArm_m * std::cos(angle_rad);
    const double y = kArm_m * std::sin(angle_rad);
    const double to_x = kArm_m - x;
    const double to_y = -kLength_m - y;
    const double length_m = std::hypot(to_x, to_y);
    const double pull_N = k * (length_m - kLength_m);
    return 2.0 * (x * to_y - y * to_x) * pull_N / length_m;
  }
};

TEST(TurningObject, AGraspedPairOnSpringsGivesTheTorqueOfItsGeometry) {
  const SpringMesh mesh = PairOnSprings::mesh();
  ElasticObject<double> object(mesh, to_the_last_digits());
  object.turn(mesh);
  ASSERT_EQ(object.grab(Vector3d::Zero(), 1.1 * PairOnSprings::kArm_m), 2);
  for (const double angle_rad : {0.02, 0.2, 0.5, 1.0}) {
    SCOPED_TRACE(angle_rad);
    const Equilibrium turned =
        object.move_to(Vector3d::Zero(), Quaterniond(AngleAxisd(angle_rad, Vector3d::UnitZ())));
    ASSERT_TRUE(turned.converged && turned.reached && turned.torque_known);
    EXPECT_NEAR(turned.torque_W_Nm.z(), PairOnSprings::torque_Nm(angle_rad), 1e-9);
    EXPECT_NEAR(turned.torque_W_Nm.head<2>().norm(), 0.0, 1e-9);
    EXPECT_NEAR(turned.force_W.norm(), 0.0, 1e-8) << "the two pull against each other";
    constexpr double kStep_rad = 1e-4;
    const double slope = (PairOnSprings::torque_Nm(angle_rad + kStep_rad) -
                          PairOnSprings::torque_Nm(angle_rad - kStep_rad)) /
                         (2.0 * kStep_rad);
    EXPECT_NEAR(turned.rotational_stiffness_W_Nm_per_rad(2, 2), slope, 1e-5 * std::abs(slope));
  }
}

/// A block that stiffens, held at its top and moved and turned at random.
class TurningBlock : public ::testing::Test {
 protected:
  TurningBlock() : mesh_(block_with(5.0)), object_(mesh_, to_the_last_digits()) {
    object_.turn(mesh_);
    EXPECT_GT(object_.grab(mesh_.top_W, kPatchRadius_m), 3);
  }

  Vector3d random_vector(double scale) {
    std::uniform_real_distribution<double> real(-scale, scale);
    return {real(random_), real(random_), real(random_)};
  }
  Quaterniond random_turn(double scale_rad) {
    const Vector3d theta = random_vector(scale_rad);
    return Quaterniond(AngleAxisd(theta.norm(), theta.normalized()));
  }
  Equilibrium at(const Vector3d& displacement_W, const Quaterniond& turn_W) {
    const Equilibrium found = object_.move_to(displacement_W, turn_W);
    EXPECT_TRUE(found.converged && found.reached && found.torque_known);
    return found;
  }
  // [N m] About the tool of what pulls on some vertices.
  Vector3d torque_of(const std::vector<Vector3d>& forces_W, const Vector3d& position_W,
                     bool of_the_fixed) const {
    const std::vector<Vector3d> x_W = object_.positions_W();
    const std::vector<std::int32_t>& patch = object_.patch();
    Vector3d sum = Vector3d::Zero();
    for (std::size_t i = 0; i < x_W.size(); ++i) {
      const bool held =
          std::find(patch.begin(), patch.end(), static_cast<std::int32_t>(i)) != patch.end();
      if (of_the_fixed ? mesh_.fixed[i] != 0 : held) {
        sum += (x_W[i] - position_W).cross(forces_W[i]);
      }
    }
    return sum;
  }

  static constexpr unsigned kSeed = 241;
  std::mt19937 random_{kSeed};
  SpringMesh mesh_;
  ElasticObject<double> object_;
};

TEST_F(TurningBlock, TheTorqueIsThatOfTheSpringsOnThePatchAndOppositeOnTheGround) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  for (int i = 0; i < 5; ++i) {
    const Vector3d displacement_W = random_vector(0.003);
    const Equilibrium found = at(displacement_W, random_turn(0.3));
    const Vector3d position_W = mesh_.top_W + displacement_W;
    const auto forces_W = ::forcegrid::simulator::testing::forces_W(mesh_, object_.positions_W());
    const Vector3d on_tool_Nm = torque_of(forces_W, position_W, false);
    EXPECT_GT(on_tool_Nm.norm(), 1e-4);
    EXPECT_LE((found.torque_W_Nm - on_tool_Nm).norm(), 1e-6 * on_tool_Nm.norm());
    const Vector3d on_ground_Nm = torque_of(forces_W, position_W, true);
    EXPECT_LE((on_tool_Nm + on_ground_Nm).norm(), 1e-6 * on_tool_Nm.norm());
  }
}

TEST_F(TurningBlock, TheTorqueIsMinusTheEnergysDerivative) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  constexpr double kStep_rad = 1e-4;
  for (int i = 0; i < 3; ++i) {
    const Vector3d displacement_W = random_vector(0.003);
    const Quaterniond turn_W = random_turn(0.3);
    const Equilibrium found = at(displacement_W, turn_W);
    for (int axis = 0; axis < 3; ++axis) {
      const auto energy_J = [&](double step_rad) {
        at(displacement_W, Quaterniond(AngleAxisd(step_rad, Vector3d::Unit(axis))) * turn_W);
        return ::forcegrid::simulator::testing::energy_J(mesh_, object_.positions_W());
      };
      const double slope_Nm = (energy_J(kStep_rad) - energy_J(-kStep_rad)) / (2.0 * kStep_rad);
      EXPECT_NEAR(found.torque_W_Nm[axis], -slope_Nm, 1e-5 * found.torque_W_Nm.norm());
    }
  }
}

TEST_F(TurningBlock, TheStiffnessIsTheTorquesDerivative) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  constexpr double kStep_rad = 1e-4;
  for (int i = 0; i < 3; ++i) {
    const Vector3d displacement_W = random_vector(0.003);
    const Quaterniond turn_W = random_turn(0.3);
    const Matrix3d stiffness = at(displacement_W, turn_W).rotational_stiffness_W_Nm_per_rad;
    Matrix3d differences;
    for (int axis = 0; axis < 3; ++axis) {
      const auto torque_Nm = [&](double step_rad) {
        return at(displacement_W, Quaterniond(AngleAxisd(step_rad, Vector3d::Unit(axis))) * turn_W)
            .torque_W_Nm;
      };
      differences.col(axis) = (torque_Nm(kStep_rad) - torque_Nm(-kStep_rad)) / (2.0 * kStep_rad);
    }
    EXPECT_LE((stiffness - differences).norm(), 1e-4 * differences.norm())
        << stiffness << "\nby differences\n"
        << differences;
  }
}

// The torque's, and by the energy's symmetry the force's by the turn.
TEST_F(TurningBlock, TheGradientIsTheTorquesDerivativeByThePlaceAndTheForcesByTheTurn) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  constexpr double kStep_m = 2e-6;
  constexpr double kStep_rad = 1e-4;
  for (int i = 0; i < 3; ++i) {
    const Vector3d displacement_W = random_vector(0.003);
    const Quaterniond turn_W = random_turn(0.3);
    const Matrix3d gradient_N = at(displacement_W, turn_W).torque_gradient_W_N;
    Matrix3d by_place;
    Matrix3d by_turn;
    for (int axis = 0; axis < 3; ++axis) {
      const auto torque_Nm = [&](double step_m) {
        return at(displacement_W + step_m * Vector3d::Unit(axis), turn_W).torque_W_Nm;
      };
      const auto force_N = [&](double step_rad) {
        return at(displacement_W, Quaterniond(AngleAxisd(step_rad, Vector3d::Unit(axis))) * turn_W)
            .force_W;
      };
      by_place.col(axis) = (torque_Nm(kStep_m) - torque_Nm(-kStep_m)) / (2.0 * kStep_m);
      by_turn.col(axis) = (force_N(kStep_rad) - force_N(-kStep_rad)) / (2.0 * kStep_rad);
    }
    EXPECT_GT(by_place.norm(), 0.05) << "N: a shift matters";
    EXPECT_LE((gradient_N - by_place).norm(), 1e-4 * by_place.norm())
        << gradient_N << "\nby differences\n"
        << by_place;
    EXPECT_LE((gradient_N - by_turn.transpose()).norm(), 1e-4 * by_turn.norm());
  }
}

TEST_F(TurningBlock, GoesFarInStepsAndComesBack) {
  const Vector3d down(0.0, 0.0, -0.002);
  const Equilibrium before = at(down, Quaterniond::Identity());
  const Equilibrium far = at(down, Quaterniond(AngleAxisd(1.0, Vector3d::UnitZ())));
  EXPECT_GT(far.steps, 2);
  EXPECT_LT(far.torque_W_Nm.z(), -1e-3) << "the block turns the tool back";
  const Equilibrium after = at(down, Quaterniond::Identity());
  EXPECT_LE((after.force_W - before.force_W).norm(), 1e-7 * before.force_W.norm());
  EXPECT_LE((after.torque_W_Nm - before.torque_W_Nm).norm(), 1e-7 * far.torque_W_Nm.norm());
}

template <typename Real>
void expect_the_force_of_a_tool_that_does_not_turn() {
  const SpringMesh mesh = block_with(5.0);
  ElasticObject<Real> plain(mesh);
  ElasticObject<Real> turning(mesh);
  turning.turn(mesh);
  for (int contact = 0; contact < 2; ++contact) {
    ASSERT_EQ(plain.grab(mesh.top_W, kPatchRadius_m), turning.grab(mesh.top_W, kPatchRadius_m));
    for (int step = 1; step <= 20; ++step) {
      const Vector3d displacement_W(1e-4 * step, -2e-4 * step, -3e-4 * step * (step % 3));
      const Equilibrium expected = plain.move_to(displacement_W);
      const Equilibrium found = turning.move_to(displacement_W, Quaterniond::Identity());
      ASSERT_EQ(found.force_W, expected.force_W) << step;
      ASSERT_EQ(found.stiffness_W, expected.stiffness_W) << step;
      ASSERT_EQ(found.relative_residual, expected.relative_residual) << step;
      ASSERT_FALSE(expected.torque_known);
      ASSERT_TRUE(found.torque_known);
    }
    turning.move_to(Vector3d::Zero(), Quaterniond(AngleAxisd(0.3, Vector3d::UnitX())));
    plain.release();
    turning.release();
  }
}

TEST(TurningObject, NotTurnedHasTheOldForcesToTheLastDigit) {
  expect_the_force_of_a_tool_that_does_not_turn<float>();
  expect_the_force_of_a_tool_that_does_not_turn<double>();
}

TEST(TurningObject, InSinglePrecisionIsNearTheExactTorque) {
  const SpringMesh mesh = block_with(5.0);
  ElasticObject<double> exact(mesh, to_the_last_digits());
  ElasticObject<float> quick(mesh);
  exact.turn(mesh);
  quick.turn(mesh);
  exact.grab(mesh.top_W, kPatchRadius_m);
  quick.grab(mesh.top_W, kPatchRadius_m);
  for (int step = 1; step <= 20; ++step) {
    const Vector3d displacement_W(0.0, 1e-4 * step, -2e-4 * step);
    const Quaterniond turn_W(AngleAxisd(0.02 * step, Vector3d(0.2, 0.1, 1.0).normalized()));
    const Equilibrium expected = exact.move_to(displacement_W, turn_W);
    const Equilibrium found = quick.move_to(displacement_W, turn_W);
    ASSERT_TRUE(found.torque_known);
    // The solver's default tolerance of the force is 1e-3.
    EXPECT_LE((found.torque_W_Nm - expected.torque_W_Nm).norm(),
              2e-3 * expected.torque_W_Nm.norm());
    EXPECT_LE((found.rotational_stiffness_W_Nm_per_rad - expected.rotational_stiffness_W_Nm_per_rad)
                  .norm(),
              0.02 * expected.rotational_stiffness_W_Nm_per_rad.norm());
  }
}

TEST(TurningObject, KeepsItsAnswerForATurnThatIsNotFinite) {
  const SpringMesh mesh = block_with(0.0);
  ElasticObject<float> object(mesh);
  object.turn(mesh);
  object.grab(mesh.top_W, kPatchRadius_m);
  const Quaterniond turn_W(AngleAxisd(0.1, Vector3d::UnitY()));
  const Equilibrium before = object.move_to({0.0, 0.0, -0.001}, turn_W);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Equilibrium after = object.move_to({0.0, 0.0, -0.002}, Quaterniond(1.0, nan, 0.0, 0.0));
  EXPECT_FALSE(after.converged);
  EXPECT_FALSE(after.reached);
  EXPECT_EQ(after.torque_W_Nm, before.torque_W_Nm);
  EXPECT_EQ(after.force_W, before.force_W);
}

TEST(TurningObject, CountsTheMemoryOfItsSecondState) {
  const SpringMesh mesh = block_with(0.0);
  ElasticObject<float> object(mesh);
  const std::size_t before = object.memory_bytes();
  object.turn(mesh);
  // T and what solves for it: as much again as S has.
  EXPECT_GT(object.memory_bytes(), before + before / 2);
  EXPECT_LT(object.memory_bytes(), 3 * before);
}

TEST(TurningObject, IsSolvedAsAWholeOrNotAtAll) {
  const SpringMesh mesh = block_with(0.0);
  SolverOptions options;
  options.border_tolerance = 0.01;
  ElasticObject<float> object(mesh, options);
  EXPECT_THAT([&] { object.turn(mesh); },
              ::testing::ThrowsMessage<Error>(::testing::HasSubstr("quasi_static")));
}

}  // namespace
}  // namespace forcegrid::simulator
