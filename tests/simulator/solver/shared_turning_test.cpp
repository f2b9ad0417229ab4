// SPDX-License-Identifier: Apache-2.0
// SharedObject under tools that turn: the torque on each, beside the scalar reference's energy.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <random>

#include "reference_springs.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/solver/shared_object.h"

namespace forcegrid::simulator {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kPatchRadius_m = 0.012;
const std::array<Vector3d, 2> kTouch_W = {Vector3d(-0.018, 0.001, 0), Vector3d(0.018, 0, 0)};

SpringMesh little_block() {
  LatticeBlockOptions options;
  options.vertex_count = {7, 6, 5};
  options.size_m = {0.06, 0.05, 0.04};
  options.law.cubic_coefficient = 5.0;
  return make_lattice_block(options);
}

SolverOptions to_the_last_digits() {
  SolverOptions options;
  options.relative_tolerance = 1e-10;
  options.sensitivity_tolerance = 1e-5;  // S and T are single precision
  options.max_iterations = 4000;
  return options;
}

Quaterniond turn_by(const Vector3d& theta_W_rad) {
  return Quaterniond(AngleAxisd(theta_W_rad.norm(), theta_W_rad.normalized()));
}

/// Where both tools are.
struct Poses {
  std::array<Vector3d, 2> displacement_W{Vector3d::Zero(), Vector3d::Zero()};
  std::array<Quaterniond, 2> turn_W{Quaterniond::Identity(), Quaterniond::Identity()};
};

/// Two tools that hold a block which stiffens, moved and turned at random.
class TwoTurningTools : public ::testing::Test {
 protected:
  TwoTurningTools() : mesh_(little_block()), object_(mesh_, to_the_last_digits(), 2) {
    object_.turn(mesh_);
    for (std::size_t k = 0; k < 2; ++k) {
      EXPECT_GT(object_.grab(k, kTouch_W[k], kPatchRadius_m), 3);
    }
  }

  Vector3d random_vector(double scale) {
    std::uniform_real_distribution<double> real(-scale, scale);
    return {real(random_), real(random_), real(random_)};
  }
  Poses random_poses() {
    Poses poses;
    for (std::size_t k = 0; k < 2; ++k) {
      poses.displacement_W[k] = random_vector(0.003);
      poses.turn_W[k] = turn_by(random_vector(0.3));
    }
    return poses;
  }
  void solve(const Poses& poses) {
    for (std::size_t k = 0; k < 2; ++k) {
      object_.aim(k, poses.displacement_W[k], poses.turn_W[k]);
    }
    object_.solve();
    for (std::size_t k = 0; k < 2; ++k) {
      const Equilibrium& found = object_.equilibrium(k);
      EXPECT_TRUE(found.converged && found.reached && found.torque_known) << k;
      EXPECT_LT(found.turn_W.angularDistance(poses.turn_W[k]), 1e-12) << k;
    }
  }
  double energy_J(const Poses& poses) {
    solve(poses);
    return ::forcegrid::simulator::testing::energy_J(mesh_, object_.positions_W());
  }

  static constexpr unsigned kSeed = 246;
  std::mt19937 random_{kSeed};
  SpringMesh mesh_;
  SharedObject<double> object_;
};

TEST_F(TwoTurningTools, EachTorqueIsMinusTheEnergysDerivativeByItsTurnAndEachForceByItsPlace) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  constexpr double kStep_rad = 1e-4;
  constexpr double kStep_m = 2e-6;
  for (int i = 0; i < 3; ++i) {
    const Poses poses = random_poses();
    solve(poses);
    const std::array<Equilibrium, 2> found = {object_.equilibrium(0), object_.equilibrium(1)};
    for (std::size_t k = 0; k < 2; ++k) {
      for (int axis = 0; axis < 3; ++axis) {
        SCOPED_TRACE(::testing::Message() << "case " << i << ", tool " << k << ", axis " << axis);
        const auto turned_J = [&](double step_rad) {
          Poses moved = poses;
          moved.turn_W[k] =
              Quaterniond(AngleAxisd(step_rad, Vector3d::Unit(axis))) * poses.turn_W[k];
          return energy_J(moved);
        };
        const auto shifted_J = [&](double step_m) {
          Poses moved = poses;
          moved.displacement_W[k] += step_m * Vector3d::Unit(axis);
          return energy_J(moved);
        };
        const double torque_Nm = -(turned_J(kStep_rad) - turned_J(-kStep_rad)) / (2.0 * kStep_rad);
        const double force_N = -(shifted_J(kStep_m) - shifted_J(-kStep_m)) / (2.0 * kStep_m);
        EXPECT_GT(found[k].torque_W_Nm.norm(), 1e-4);
        EXPECT_NEAR(found[k].torque_W_Nm[axis], torque_Nm, 1e-5 * found[k].torque_W_Nm.norm());
        EXPECT_NEAR(found[k].force_W[axis], force_N, 1e-4 * found[k].force_W.norm());
      }
    }
  }
}

TEST_F(TwoTurningTools, HaveTheDerivativesOfTheirTorques) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  constexpr double kStep_rad = 1e-4;
  constexpr double kStep_m = 2e-6;
  const Poses poses = random_poses();
  for (std::size_t k = 0; k < 2; ++k) {
    SCOPED_TRACE(k);
    solve(poses);
    const Equilibrium found = object_.equilibrium(k);
    ASSERT_TRUE(found.rotational_stiffness_known);
    const auto mixed = object_.stiffness_W(k, 1 - k);
    ASSERT_TRUE(mixed);
    Matrix3d by_turn;
    Matrix3d by_place;
    Matrix3d by_the_others_place;
    for (int axis = 0; axis < 3; ++axis) {
      const auto at = [&](double theta_rad, double own_m, double others_m) {
        Poses moved = poses;
        moved.turn_W[k] =
            Quaterniond(AngleAxisd(theta_rad, Vector3d::Unit(axis))) * poses.turn_W[k];
        moved.displacement_W[k] += own_m * Vector3d::Unit(axis);
        moved.displacement_W[1 - k] += others_m * Vector3d::Unit(axis);
        solve(moved);
        return object_.equilibrium(k);
      };
      by_turn.col(axis) =
          (at(kStep_rad, 0, 0).torque_W_Nm - at(-kStep_rad, 0, 0).torque_W_Nm) / (2.0 * kStep_rad);
      by_place.col(axis) =
          (at(0, kStep_m, 0).torque_W_Nm - at(0, -kStep_m, 0).torque_W_Nm) / (2.0 * kStep_m);
      by_the_others_place.col(axis) =
          (at(0, 0, kStep_m).force_W - at(0, 0, -kStep_m).force_W) / (2.0 * kStep_m);
    }
    EXPECT_LE((found.rotational_stiffness_W_Nm_per_rad - by_turn).norm(), 1e-4 * by_turn.norm());
    EXPECT_LE((found.torque_gradient_W_N - by_place).norm(), 1e-4 * by_place.norm());
    EXPECT_LE((*mixed - by_the_others_place).norm(), 1e-3 * by_the_others_place.norm());
  }
}

TEST_F(TwoTurningTools, GoFarInStepsAndComeBack) {
  Poses near;
  near.displacement_W = {Vector3d(0, 0, -0.001), Vector3d(0, 0, 0.002)};
  Poses far = near;
  far.turn_W = {turn_by({0, 0, 0.8}), turn_by({0, 0.4, -0.6})};
  solve(near);
  const Equilibrium before = object_.equilibrium(1);
  solve(far);
  EXPECT_GT(object_.equilibrium(0).steps, 2);
  EXPECT_LT(object_.equilibrium(0).torque_W_Nm.z(), -1e-3) << "the block turns the tool back";
  EXPECT_GT(object_.equilibrium(1).torque_W_Nm.z(), 1e-3);
  solve(near);
  EXPECT_LE((object_.equilibrium(1).force_W - before.force_W).norm(), 1e-6 * before.force_W.norm());
}

// What one tool leaves behind when it lets go is what the other would have found alone.
TEST_F(TwoTurningTools, LettingGoLeavesTheTorqueOfTheOtherToolAlone) {
  Poses poses;
  poses.displacement_W[0] = {0.001, -0.001, -0.002};
  poses.turn_W[0] = turn_by({0.1, -0.1, 0.3});
  poses.turn_W[1] = turn_by({0, 0.2, -0.3});
  solve(poses);
  const Vector3d with_both_Nm = object_.equilibrium(0).torque_W_Nm;
  object_.release(1);
  object_.solve();
  ElasticObject<double> alone(mesh_, to_the_last_digits());
  alone.turn(mesh_);
  alone.grab(kTouch_W[0], kPatchRadius_m);
  const Equilibrium expected = alone.move_to(poses.displacement_W[0], poses.turn_W[0]);
  const Equilibrium& found = object_.equilibrium(0);
  ASSERT_TRUE(found.converged && found.torque_known && expected.converged);
  EXPECT_LE((found.torque_W_Nm - expected.torque_W_Nm).norm(), 1e-6 * expected.torque_W_Nm.norm());
  EXPECT_GT((with_both_Nm - expected.torque_W_Nm).norm(), 1e-3 * expected.torque_W_Nm.norm());
  EXPECT_FALSE(object_.stiffness_W(0, 1)) << "it holds nothing";
  // It takes hold again, upright, of the object as the first tool has turned it.
  ASSERT_GT(object_.grab(1, kTouch_W[1], kPatchRadius_m), 3);
  EXPECT_LT(object_.equilibrium(1).torque_W_Nm.norm(), 1e-6) << "a touch begins without a torque";
  EXPECT_LE((object_.equilibrium(0).torque_W_Nm - expected.torque_W_Nm).norm(),
            1e-6 * expected.torque_W_Nm.norm());
}

template <typename Real>
void expect_the_force_of_tools_that_do_not_turn() {
  const SpringMesh mesh = little_block();
  SharedObject<Real> plain(mesh, {}, 2);
  SharedObject<Real> turning(mesh, {}, 2);
  turning.turn(mesh);
  for (std::size_t k = 0; k < 2; ++k) {
    ASSERT_EQ(plain.grab(k, kTouch_W[k], kPatchRadius_m),
              turning.grab(k, kTouch_W[k], kPatchRadius_m));
  }
  for (int step = 1; step <= 10; ++step) {
    for (std::size_t k = 0; k < 2; ++k) {
      const Vector3d to_W(1e-4 * step, -2e-4 * step, (k == 0 ? 3e-4 : -2e-4) * (step % 3));
      plain.aim(k, to_W);
      turning.aim(k, to_W, Quaterniond::Identity());
    }
    plain.solve();
    turning.solve();
    for (std::size_t k = 0; k < 2; ++k) {
      ASSERT_EQ(turning.equilibrium(k).force_W, plain.equilibrium(k).force_W) << step;
      ASSERT_EQ(turning.equilibrium(k).stiffness_W, plain.equilibrium(k).stiffness_W) << step;
    }
  }
}

TEST(SharedTurning, WithoutATurnEveryDigitOfTheForceIsThatOfToolsThatCannot) {
  expect_the_force_of_tools_that_do_not_turn<float>();
  expect_the_force_of_tools_that_do_not_turn<double>();
}

TEST(SharedTurning, InSinglePrecisionIsAsGoodAsItsTolerance) {
  const SpringMesh mesh = little_block();
  SharedObject<double> exact(mesh, to_the_last_digits(), 2);
  SharedObject<float> quick(mesh, {}, 2);
  exact.turn(mesh);
  quick.turn(mesh);
  for (std::size_t k = 0; k < 2; ++k) {
    exact.grab(k, kTouch_W[k], kPatchRadius_m);
    quick.grab(k, kTouch_W[k], kPatchRadius_m);
    const Vector3d to_W(0.001, 0.002, k == 0 ? -0.003 : 0.002);
    const Quaterniond turn_W = turn_by({0.1, -0.2, k == 0 ? 0.3 : -0.25});
    exact.aim(k, to_W, turn_W);
    quick.aim(k, to_W, turn_W);
  }
  exact.solve();
  quick.solve();
  for (std::size_t k = 0; k < 2; ++k) {
    const Vector3d expected_Nm = exact.equilibrium(k).torque_W_Nm;
    ASSERT_TRUE(quick.equilibrium(k).converged && quick.equilibrium(k).torque_known);
    EXPECT_LE((quick.equilibrium(k).torque_W_Nm - expected_Nm).norm(), 5e-3 * expected_Nm.norm());
  }
}

TEST(SharedTurning, IgnoresATurnThatIsNotFiniteAndRefusesToBeginLate) {
  const SpringMesh mesh = little_block();
  SharedObject<double> object(mesh, {}, 2);
  object.turn(mesh);
  object.grab(0, kTouch_W[0], kPatchRadius_m);
  object.aim(0, Vector3d(0, 0, -0.001), turn_by({0, 0, 0.2}));
  object.solve();
  const Vector3d before_Nm = object.equilibrium(0).torque_W_Nm;
  Quaterniond broken = turn_by({0, 0, 0.3});
  broken.x() = std::numeric_limits<double>::quiet_NaN();
  object.aim(0, Vector3d(0, 0, -0.002), broken);
  object.solve();
  EXPECT_LE((object.equilibrium(0).torque_W_Nm - before_Nm).norm(), 1e-3 * before_Nm.norm());
  EXPECT_THAT([&] { object.turn(mesh); },
              ::testing::ThrowsMessage<Error>(::testing::HasSubstr("call turn() before grab()")));
}

}  // namespace
}  // namespace forcegrid::simulator
