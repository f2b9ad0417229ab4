// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/shared_object.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/scene.h"
#include "tests/simulator/dense_newton.h"
#include "tests/simulator/element_block.h"
#include "tests/simulator/two_tool_newton.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Points = TwoToolNewton::Points;

constexpr double kPatchRadius_m = 0.012;

SolverOptions tight(double relative_tolerance = 1e-9) {
  SolverOptions options;
  options.relative_tolerance = relative_tolerance;
  options.sensitivity_tolerance = 1e-4;
  options.max_iterations = 4000;
  return options;
}

// Vertices 0.1 m apart along z, the lowest one fixed, with a spring between each and the next.
SpringMesh chain(const std::vector<double>& stiffness_N_per_m, double cubic = 0.0) {
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, 0}};
  mesh.fixed = {1};
  mesh.laws = {{.cubic_coefficient = cubic}};
  for (std::size_t i = 0; i < stiffness_N_per_m.size(); ++i) {
    mesh.rest_position_W.emplace_back(0, 0, 0.1 * static_cast<double>(i + 1));
    mesh.fixed.push_back(0);
    mesh.springs.push_back(
        {static_cast<std::int32_t>(i), static_cast<std::int32_t>(i + 1), stiffness_N_per_m[i]});
  }
  return mesh;
}

SpringMesh little_block() {
  LatticeBlockOptions options;
  options.vertex_count = {7, 6, 5};
  options.size_m = {0.06, 0.05, 0.04};
  options.law.cubic_coefficient = 5.0;
  return make_lattice_block(options);
}

// Left and right on the top of that block; their patches do not meet.
const Points kTouch_W = {Vector3d(-0.018, 0, 0), Vector3d(0.018, 0, 0)};

template <typename Real>
void move(SharedObject<Real>& object, const Points& displacement_W) {
  object.aim(0, displacement_W[0]);
  object.aim(1, displacement_W[1]);
  object.solve();
}

// dF_i / dP_j by central differences of what `forces` gives.
template <typename Forces>
Matrix3d slope(Forces forces, const Points& at_W, std::size_t i, std::size_t j, double step_m) {
  Matrix3d result;
  for (int c = 0; c < 3; ++c) {
    Points ahead_W = at_W;
    Points behind_W = at_W;
    ahead_W[j][c] += step_m;
    behind_W[j][c] -= step_m;
    result.col(c) = (forces(ahead_W)[i] - forces(behind_W)[i]) / (2.0 * step_m);
  }
  return result;
}

// Ground -40- left -10- free -20- right: between the tools two springs in series.
TEST(SharedObject, SpringsInSeriesBetweenTwoToolsGiveTheTextbookForces) {
  SharedObject<double> object(chain({40.0, 10.0, 20.0}), tight(), 2);
  ASSERT_EQ(object.grab(0, {0, 0, 0.1}, 0.01), 1);
  ASSERT_EQ(object.grab(1, {0, 0, 0.3}, 0.01), 1);
  const double k = 10.0 * 20.0 / (10.0 + 20.0);
  const double left_m = -0.004;
  const double right_m = 0.02;
  move(object, {Vector3d(0, 0, left_m), Vector3d(0, 0, right_m)});
  const Equilibrium& left = object.equilibrium(0);
  const Equilibrium& right = object.equilibrium(1);
  EXPECT_TRUE(left.converged && right.converged && left.reached);
  EXPECT_NEAR(right.force_W.z(), -k * (right_m - left_m), 1e-8);
  EXPECT_NEAR(left.force_W.z(), k * (right_m - left_m) - 40.0 * left_m, 1e-8);
  // dF_i/dP_i: the other tool is a wall. S is in single precision.
  EXPECT_NEAR(right.stiffness_W(2, 2), -k, 1e-4);
  EXPECT_NEAR(left.stiffness_W(2, 2), -(40.0 + k), 1e-4);
  // The free vertex divides the way between the tools by the other's stiffness.
  EXPECT_NEAR(object.positions_W()[2].z(), 0.2 + left_m + (right_m - left_m) * 20.0 / (10.0 + 20.0),
              1e-9);
}

TEST(SharedObject, HardeningSpringsInSeriesShareTheForceOfTheScalarEquation) {
  const auto tension = [](double k, double stretch_m) {
    const double e = stretch_m / 0.1;
    return k * 0.1 * (e + 5.0 * e * e * e);
  };
  const double between_m = 0.04;
  double low = 0.0;
  double high = between_m;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (tension(10.0, middle) < tension(20.0, between_m - middle) ? low : high) = middle;
  }
  SharedObject<double> object(chain({40.0, 10.0, 20.0}, 5.0), tight(), 2);
  object.grab(0, {0, 0, 0.1}, 0.01);
  object.grab(1, {0, 0, 0.3}, 0.01);
  move(object, {Vector3d(0, 0, -0.01), Vector3d(0, 0, 0.03)});
  EXPECT_NEAR(object.equilibrium(1).force_W.z(), -tension(10.0, low), 1e-8);
  EXPECT_NEAR(object.equilibrium(0).force_W.z(), tension(10.0, low) - tension(40.0, -0.01), 1e-8);
}

TEST(SharedObject, WithOneToolIsTheElasticObject) {
  ElasticObject<double> alone(little_block(), tight());
  SharedObject<double> shared(little_block(), tight(), 2);
  ASSERT_EQ(shared.grab(1, kTouch_W[1], kPatchRadius_m), alone.grab(kTouch_W[1], kPatchRadius_m));
  for (int n = 1; n <= 6; ++n) {
    const Vector3d to_W(0.002 * n, -0.001 * n, 0.0015 * n);
    const Equilibrium expected = alone.move_to(to_W);
    shared.aim(1, to_W);
    shared.solve();
    const Equilibrium& found = shared.equilibrium(1);
    ASSERT_TRUE(expected.converged && found.converged);
    EXPECT_LT((found.force_W - expected.force_W).norm(), 1e-7 * expected.force_W.norm());
    EXPECT_LT((found.stiffness_W - expected.stiffness_W).norm(),
              1e-3 * expected.stiffness_W.norm());
  }
  EXPECT_EQ(shared.equilibrium(0).force_W, Vector3d::Zero());
}

class TwoToolReference : public testing::TestWithParam<SpringMesh (*)()> {};

// Both tools move at once along a bent path; the reference solves each place from rest.
TEST_P(TwoToolReference, GivesTheForcesOfADenseNewtonMethod) {
  const SpringMesh mesh = GetParam()();
  TwoToolNewton reference(mesh, kTouch_W, kPatchRadius_m);
  SharedObject<double> object(mesh, tight(), 2);
  ASSERT_EQ(object.grab(0, kTouch_W[0], kPatchRadius_m),
            static_cast<int>(reference.held[0].size()));
  ASSERT_EQ(object.grab(1, kTouch_W[1], kPatchRadius_m),
            static_cast<int>(reference.held[1].size()));
  ASSERT_GT(reference.held[0].size() * reference.held[1].size(), 0U);
  for (int n = 1; n <= 7; n += 2) {
    const double phase = 0.25 * std::numbers::pi * n;
    const Points to_W = {0.001 * n * Vector3d(-0.5, std::cos(phase), 1.0),
                         0.006 * Vector3d(std::sin(phase), 0.4, -std::cos(phase))};
    move(object, to_W);
    const TwoToolNewton::Forces expected = reference.at(to_W);
    ASSERT_LT(expected.residual_N, 1e-10);
    for (std::size_t k = 0; k < 2; ++k) {
      SCOPED_TRACE(testing::Message() << "place " << n << ", tool " << k);
      ASSERT_TRUE(object.equilibrium(k).converged);
      EXPECT_LT((object.equilibrium(k).force_W - expected.tool_W[k]).norm(),
                1e-6 * expected.tool_W[k].norm());
    }
  }
}

// The reference's slopes are of forces that a dense factor gives; the solver's own J_k and the
// slopes of its forces are compared with them, and with each other's transpose.
TEST_P(TwoToolReference, HasTheSlopesOfItAndTheyAreSymmetric) {
  const SpringMesh mesh = GetParam()();
  TwoToolNewton reference(mesh, kTouch_W, kPatchRadius_m);
  SharedObject<double> object(mesh, tight(1e-10), 2);
  object.grab(0, kTouch_W[0], kPatchRadius_m);
  object.grab(1, kTouch_W[1], kPatchRadius_m);
  const Points at_W = {Vector3d(-0.002, 0.003, 0.004), Vector3d(0.003, 0.001, -0.002)};
  const auto solver = [&](const Points& to_W) {
    move(object, to_W);
    return Points{object.equilibrium(0).force_W, object.equilibrium(1).force_W};
  };
  const auto newton = [&](const Points& to_W) { return reference.at(to_W).tool_W; };
  solver(at_W);
  const std::array<Matrix3d, 2> own = {object.equilibrium(0).stiffness_W,
                                       object.equilibrium(1).stiffness_W};
  std::array<std::array<Matrix3d, 2>, 2> mixed;
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t j = 0; j < 2; ++j) {
      const auto known = object.stiffness_W(i, j);
      ASSERT_TRUE(known);
      mixed[i][j] = *known;
    }
    EXPECT_LT((mixed[i][i] - own[i]).norm(), 1e-5 * own[i].norm());
  }
  constexpr double kStep_m = 2e-5;
  std::array<std::array<Matrix3d, 2>, 2> found;
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t j = 0; j < 2; ++j) {
      SCOPED_TRACE(testing::Message() << "dF_" << i << "/dP_" << j);
      const Matrix3d expected = slope(newton, at_W, i, j, kStep_m);
      found[i][j] = slope(solver, at_W, i, j, kStep_m);
      EXPECT_GT(expected.norm(), 0.5) << "N/m: the tools feel each other";
      EXPECT_LT((found[i][j] - expected).norm(), 1e-3 * expected.norm());
      EXPECT_LT((mixed[i][j] - expected).norm(), 1e-3 * expected.norm())
          << mixed[i][j] << "\nby differences\n"
          << expected;
    }
    EXPECT_LT((own[i] - found[i][i]).norm(), 1e-3 * own[i].norm());
    EXPECT_LT((found[i][i] - found[i][i].transpose()).norm(), 1e-3 * own[i].norm());
  }
  EXPECT_LT((found[0][1] - found[1][0].transpose()).norm(), 2e-3 * found[0][1].norm());
}

// Nothing but tools and ground holds the object, so their forces on it sum to nothing.
TEST_P(TwoToolReference, ActionIsReaction) {
  const SpringMesh mesh = GetParam()();
  TwoToolNewton patches(mesh, kTouch_W, kPatchRadius_m);
  SharedObject<double> object(mesh, tight(), 2);
  object.grab(0, kTouch_W[0], kPatchRadius_m);
  object.grab(1, kTouch_W[1], kPatchRadius_m);
  move(object, {Vector3d(-0.004, 0.002, 0.006), Vector3d(0.005, -0.003, 0.001)});
  const TwoToolNewton::Forces sums =
      TwoToolNewton::forces(mesh, object.positions_W(), patches.held, mesh.fixed);
  const Vector3d left_W = object.equilibrium(0).force_W;
  const Vector3d right_W = object.equilibrium(1).force_W;
  ASSERT_GT(left_W.norm(), 0.05);
  EXPECT_LT((left_W - sums.tool_W[0]).norm(), 1e-6 * left_W.norm());
  EXPECT_LT((left_W + right_W + sums.ground_W).norm(), 1e-6 * left_W.norm());
}

SpringMesh corotated_block() {
  return element_block({6, 4, 3}, 0.01, soft(ElementModel::kCorotated), 0.1);
}
SpringMesh neo_hookean_block() {
  return element_block({6, 4, 3}, 0.01, soft(ElementModel::kNeoHookean), 0.1);
}
INSTANTIATE_TEST_SUITE_P(Springs, TwoToolReference, testing::Values(&little_block));
INSTANTIATE_TEST_SUITE_P(Corotated, TwoToolReference, testing::Values(&corotated_block));
INSTANTIATE_TEST_SUITE_P(NeoHookean, TwoToolReference, testing::Values(&neo_hookean_block));

// Of a chain between two tools that the ground does not hold.
TEST(SharedObject, ToolsThatPullAtEachOtherFeelOppositeForces) {
  SpringMesh mesh = chain({40.0, 10.0, 20.0});
  mesh.rest_position_W.emplace_back(1.0, 0.0, 0.0);  // held by the ground, far away
  mesh.rest_position_W.emplace_back(1.0, 0.0, 0.1);
  mesh.fixed[0] = 0;
  mesh.fixed.insert(mesh.fixed.end(), {1, 0});
  mesh.springs.push_back({4, 5, 30.0});
  SharedObject<double> object(mesh, tight(), 2);
  ASSERT_EQ(object.grab(0, {0, 0, 0}, 0.01), 1);
  ASSERT_EQ(object.grab(1, {0, 0, 0.3}, 0.01), 1);
  move(object, {Vector3d(0, 0.01, -0.01), Vector3d(0.02, 0, 0.02)});
  const Vector3d left_W = object.equilibrium(0).force_W;
  ASSERT_GT(left_W.norm(), 0.1);
  EXPECT_LT((left_W + object.equilibrium(1).force_W).norm(), 1e-8);
}

TEST(SharedObject, ATouchOnTheDeformedObjectBeginsWithoutForce) {
  SharedObject<double> object(little_block(), tight(), 2);
  object.grab(0, kTouch_W[0], kPatchRadius_m);
  object.aim(0, {-0.004, 0.0, 0.006});
  object.solve();
  const Vector3d before_W = object.equilibrium(0).force_W;
  const Matrix3d stiffness_before_W = object.equilibrium(0).stiffness_W;
  ASSERT_GT(object.grab(1, kTouch_W[1], kPatchRadius_m), 0);
  object.solve();
  EXPECT_LT(object.equilibrium(1).force_W.norm(), 1e-6 * before_W.norm());
  EXPECT_LT((object.equilibrium(0).force_W - before_W).norm(), 1e-6 * before_W.norm());
  // A second hold makes the object stiffer for the first: the energy has fewer ways out.
  EXPECT_LT(
      (object.equilibrium(0).stiffness_W - stiffness_before_W).eigenvalues().real().maxCoeff(),
      1e-2);
  EXPECT_LT(object.equilibrium(0).stiffness_W.trace(), stiffness_before_W.trace() - 1.0);
}

TEST(SharedObject, LettingGoLeavesTheForceOfTheOtherToolAlone) {
  SharedObject<double> object(little_block(), tight(), 2);
  object.grab(0, kTouch_W[0], kPatchRadius_m);
  object.grab(1, kTouch_W[1], kPatchRadius_m);
  const Points to_W = {Vector3d(-0.004, 0.002, 0.005), Vector3d(0.005, 0.0, 0.008)};
  move(object, to_W);
  object.release(1);
  EXPECT_TRUE(object.equilibrium(0).left_branch) << "its force has jumped";
  EXPECT_FALSE(object.grabbed(1));
  EXPECT_EQ(object.equilibrium(1).force_W, Vector3d::Zero());
  object.solve();
  DenseNewton alone(little_block(), kTouch_W[0], kPatchRadius_m);
  const Vector3d expected_W = alone.force_at(to_W[0]);
  EXPECT_TRUE(object.equilibrium(0).converged);
  EXPECT_FALSE(object.equilibrium(0).left_branch);
  EXPECT_LT((object.equilibrium(0).force_W - expected_W).norm(), 1e-6 * expected_W.norm());
  object.release(0);
  const SpringMesh mesh = little_block();
  const std::vector<Vector3d> now_W = object.positions_W();
  for (std::size_t i = 0; i < now_W.size(); ++i) {
    EXPECT_LT((now_W[i] - mesh.rest_position_W[i]).norm(), 1e-12);
  }
}

TEST(SharedObject, AVertexHasOneToolAtATime) {
  SharedObject<double> object(little_block(), tight(), 2);
  const int first = object.grab(0, Vector3d::Zero(), kPatchRadius_m);
  ASSERT_GT(first, 1);
  EXPECT_EQ(object.grab(1, Vector3d::Zero(), kPatchRadius_m), 0) << "all held already";
  EXPECT_FALSE(object.grabbed(1));
  const int second = object.grab(1, {0.01, 0, 0}, kPatchRadius_m);
  ASSERT_GT(second, 0) << "those that the first one does not hold";
  for (const std::int32_t i : object.patch(1)) {
    EXPECT_EQ(std::ranges::count(object.patch(0), i), 0);
  }
  EXPECT_THROW(object.grab(1, {0.01, 0, 0}, kPatchRadius_m), Error);
}

TEST(SharedObject, InSinglePrecisionIsAsGoodAsItsTolerance) {
  SharedObject<float> object(little_block(), SolverOptions{}, 2);
  TwoToolNewton reference(little_block(), kTouch_W, kPatchRadius_m);
  object.grab(0, kTouch_W[0], kPatchRadius_m);
  object.grab(1, kTouch_W[1], kPatchRadius_m);
  for (int n = 1; n <= 10; ++n) {
    const Points to_W = {0.001 * n * Vector3d(-0.4, 0.3, 0.6),
                         0.001 * n * Vector3d(0.6, 0.1, -0.2)};
    move(object, to_W);
    const TwoToolNewton::Forces expected = reference.at(to_W);
    for (std::size_t k = 0; k < 2; ++k) {
      EXPECT_TRUE(object.equilibrium(k).converged);
      EXPECT_LT((object.equilibrium(k).force_W - expected.tool_W[k]).norm(),
                1e-3 * std::max(0.05, expected.tool_W[k].norm()));
    }
  }
}

TEST(SharedObject, IgnoresAnAimThatIsNotFiniteAndSaysWhereALongMoveEnded) {
  SolverOptions options = tight();
  options.max_steps = 2;
  SharedObject<double> object(little_block(), options, 2);
  object.grab(0, kTouch_W[0], kPatchRadius_m);
  object.grab(1, kTouch_W[1], kPatchRadius_m);
  move(object, {Vector3d(0, 0, 0.02), Vector3d::Zero()});
  EXPECT_FALSE(object.equilibrium(0).reached);
  EXPECT_NEAR(object.equilibrium(0).displacement_W.z(), 2.0 * options.max_step_m, 1e-9);
  EXPECT_TRUE(object.equilibrium(0).converged);
  const Vector3d aim_W = object.equilibrium(0).displacement_W;
  object.aim(0, aim_W);
  object.aim(0, {0, 0, std::numeric_limits<double>::quiet_NaN()});
  object.solve();
  EXPECT_TRUE(object.equilibrium(0).reached);
  EXPECT_TRUE(object.equilibrium(0).force_W.allFinite());
}

// Up to 25 mm, 0.2 to 2 Hz, 12 mm above where it began on the average.
class Wander {
 public:
  explicit Wander(std::uint64_t seed) : random_(seed) {
    for (auto& axis : axes_) {
      for (auto& [frequency_Hz, phase_rad] : axis) {
        frequency_Hz = std::uniform_real_distribution(0.2, 2.0)(random_);
        phase_rad = std::uniform_real_distribution(0.0, 2.0 * std::numbers::pi)(random_);
      }
    }
  }
  Vector3d at(double time_s) const {
    Vector3d place_W(0.0, 0.0, 0.012);
    for (int c = 0; c < 3; ++c) {
      for (const auto& [frequency_Hz, phase_rad] : axes_[static_cast<std::size_t>(c)]) {
        place_W[c] += 0.004 * std::sin(2.0 * std::numbers::pi * frequency_Hz * time_s + phase_rad);
      }
    }
    return -std::expm1(-time_s / 0.5) * place_W;
  }

 private:
  std::mt19937_64 random_;
  std::array<std::array<std::pair<double, double>, 6>, 3> axes_;
};

// Tools 30 mm apart come near each other, so that what is between them buckles.
TEST(SharedObject, AfterItBuckledBetweenTheToolsItStandsAsFromRest) {
  const SpringMesh mesh = make_scene("small").mesh;
  const Points touch_W = {Vector3d(0, -0.015, 0), Vector3d(0, 0.015, 0)};
  const auto held = [&]<typename Real>(Real, const SolverOptions& options) {
    SharedObject<Real> object(mesh, options, 2);
    object.grab(0, touch_W[0], kPatchRadius_m);
    object.grab(1, touch_W[1], kPatchRadius_m);
    return object;
  };
  int compared = 0;
  for (const std::uint64_t seed : {1, 2, 3}) {
    const std::array<Wander, 2> hands = {Wander(seed), Wander(100 + seed)};
    SharedObject<float> object = held(float{}, SolverOptions{});
    for (int answer = 1; answer <= 300; ++answer) {
      const Points at_W = {hands[0].at(answer / 30.0), hands[1].at(answer / 30.0)};
      move(object, at_W);
      const Equilibrium& first = object.equilibrium(0);
      const Equilibrium& second = object.equilibrium(1);
      EXPECT_LT(first.relative_residual, 0.1) << "seed " << seed << ", answer " << answer;
      EXPECT_LT(second.relative_residual, 0.1) << "seed " << seed << ", answer " << answer;
      EXPECT_LT(first.force_W.norm() + second.force_W.norm(), 40.0)
          << "seed " << seed << ", answer " << answer;
      if (!first.left_branch || !first.reached || !first.converged || !second.converged) {
        continue;
      }
      SolverOptions fine = tight(1e-5);
      fine.max_step_m = 1e-3;
      fine.max_steps = 1000;
      SharedObject<double> reference = held(double{}, fine);
      move(reference, at_W);
      if (reference.equilibrium(0).left_branch) {
        continue;  // on the way, from which it does not come back
      }
      ++compared;
      for (const std::size_t k : {0U, 1U}) {
        const Vector3d expected_N = reference.equilibrium(k).force_W;
        // Near the next instability the float's tolerance of the residual is more of the force.
        EXPECT_LT((object.equilibrium(k).force_W - expected_N).norm(), 0.05 * expected_N.norm())
            << "seed " << seed << ", answer " << answer << ", tool " << k;
      }
    }
  }
  EXPECT_GE(compared, 3);
}

TEST(SharedObject, RefusesWhatItCannotSolve) {
  SolverOptions with_border;
  with_border.border_tolerance = 1e-3;
  EXPECT_THAT([&] { SharedObject<float>(little_block(), with_border, 2); },
              testing::ThrowsMessage<Error>(testing::HasSubstr("solver quasi_static")));
  EXPECT_THAT([] { SharedObject<float>(little_block(), {}, 0); },
              testing::ThrowsMessage<Error>(testing::HasSubstr("no tool")));
}

}  // namespace
}  // namespace forcegrid::simulator
