// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/direct_method.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <thread>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/reference/reference_solution.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

SpringMesh block() {
  LatticeBlockOptions options;
  options.vertex_count = {8, 8, 7};
  options.stiffness_N_per_m = 20.0;
  options.top_centre_W = {0.02, 0.03, 0.04};
  return make_lattice_block(options);
}

const Vector3d kTop_W{0.02, 0.03, 0.04};

Vector3d path_W(int cycle) {
  const double phase = 0.01 * cycle;
  return kTop_W + Vector3d(0.006 * std::sin(phase), 0.004 * std::sin(1.7 * phase),
                           0.006 * (1.0 - std::cos(phase)));
}

DirectOptions in_place() {
  DirectOptions options;
  options.grab_on_own_thread = false;
  return options;
}

TEST(DirectMethod, FollowsTheConvergedObject) {
  const SpringMesh mesh = block();
  DirectMethod direct(mesh, in_place());
  direct.contact_made(1, kTop_W);
  std::vector<Vector3d> positions_W;
  std::vector<Vector3d> forces_W;
  for (int cycle = 0; cycle < 600; ++cycle) {
    positions_W.push_back(path_W(cycle));
    direct.observe(0.002 * cycle, positions_W.back());
    const ForceEstimate estimate = direct.force(0.002 * cycle, positions_W.back());
    ASSERT_EQ(estimate.status, EstimateStatus::kOk);
    EXPECT_GE(estimate.uncertainty_N, 0.0);
    forces_W.push_back(estimate.force_W);
  }
  ReferenceOptions options;
  options.contact_point_W = kTop_W;
  options.threads = 1;
  const ReferenceSolution reference = simulate_reference(mesh, positions_W, options);
  double error = 0.0;
  double size = 0.0;
  for (std::size_t i = 0; i < forces_W.size(); ++i) {
    error += (forces_W[i] - reference.forces_W[i]).squaredNorm();
    size += reference.forces_W[i].squaredNorm();
  }
  EXPECT_LT(std::sqrt(error / size), 1e-3);
}

TEST(DirectMethod, ContinuesWithTheStiffnessBetweenObservations) {
  DirectMethod direct(block(), in_place());
  direct.contact_made(1, kTop_W);
  const Vector3d here_W = kTop_W + Vector3d(0.001, 0.0, 0.004);
  const Vector3d there_W = here_W + Vector3d(0.0002, -0.0001, 0.0003);
  // After a grip the stiffness is corrected over some cycles.
  for (int cycle = 1; cycle <= 40; ++cycle) {
    direct.observe(0.002 * cycle, kTop_W + cycle / 40.0 * (here_W - kTop_W));
  }
  const Vector3d guessed_W = direct.force(0.002, there_W).force_W;
  const Vector3d before_W = direct.force(0.002, here_W).force_W;
  direct.observe(0.004, there_W);
  const Vector3d solved_W = direct.force(0.004, there_W).force_W;
  // SolverOptions::sensitivity_tolerance is 0.05, and the law bends a little.
  EXPECT_LT((guessed_W - solved_W).norm(), 0.1 * (solved_W - before_W).norm());
}

TEST(DirectMethod, HasNoForceInTheAirAndForgetsTheOldGrip) {
  DirectMethod direct(block(), in_place());
  EXPECT_EQ(direct.force(0.0, kTop_W).status, EstimateStatus::kUnknown);
  direct.contact_made(1, kTop_W);
  direct.observe(0.0, kTop_W + Vector3d(0.0, 0.0, 0.005));
  EXPECT_LT(direct.force(0.0, kTop_W + Vector3d(0.0, 0.0, 0.005)).force_W.z(), -0.1);
  direct.contact_lost();
  EXPECT_EQ(direct.force(0.1, kTop_W).force_W, Vector3d::Zero());
  EXPECT_EQ(direct.force(0.1, kTop_W).status, EstimateStatus::kOk);
  const Vector3d elsewhere_W = kTop_W + Vector3d(0.02, -0.02, 0.0);
  direct.contact_made(3, elsewhere_W);
  EXPECT_EQ(direct.force(0.2, elsewhere_W).status, EstimateStatus::kUnknown);
  direct.observe(0.2, elsewhere_W);
  EXPECT_LT(direct.force(0.2, elsewhere_W).force_W.norm(), 1e-3);
}

TEST(DirectMethod, DoesNotKnowTheForceWhereNothingCanBeHeld) {
  DirectMethod direct(block(), in_place());
  const Vector3d far_W = kTop_W + Vector3d(1.0, 0.0, 0.0);
  direct.contact_made(1, far_W);
  direct.observe(0.0, far_W);
  EXPECT_EQ(direct.force(0.0, far_W).status, EstimateStatus::kUnknown);
  EXPECT_EQ(direct.force(0.0, far_W).force_W, Vector3d::Zero());
}

TEST(DirectMethod, AnswersWithoutWaitingWhileAGripIsSolvedElsewhere) {
  DirectMethod direct(block());
  const auto patience = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  // Grips that follow each other while older ones are still being solved: the last one counts.
  for (std::uint32_t epoch = 1; epoch < 20; ++epoch) {
    direct.contact_made(epoch, kTop_W + Vector3d(0.001 * epoch, 0.0, 0.0));
    direct.observe(0.0, kTop_W);
    direct.contact_lost();
  }
  direct.contact_made(21, kTop_W);
  const Vector3d pulled_W = kTop_W + Vector3d(0.0, 0.0, 0.003);
  while (direct.force(0.0, pulled_W).status != EstimateStatus::kOk) {
    ASSERT_LT(std::chrono::steady_clock::now(), patience) << "the grip was never finished";
    direct.observe(0.0, pulled_W);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  DirectMethod reference(block(), in_place());
  reference.contact_made(1, kTop_W);
  for (int cycle = 0; cycle < 50; ++cycle) {
    direct.observe(0.0, pulled_W);
    reference.observe(0.0, pulled_W);
  }
  const Vector3d expected_W = reference.force(0.0, pulled_W).force_W;
  EXPECT_LT((direct.force(0.0, pulled_W).force_W - expected_W).norm(), 1e-3 * expected_W.norm());
}

TEST(DirectMethod, MeasuresItsCycleAndItsMemory) {
  DirectMethod direct(block(), in_place());
  const double cycle_s = direct.measured_cycle_s(0.002);
  EXPECT_GT(cycle_s, 1e-7);
  EXPECT_LT(cycle_s, 1.0);
  // At least its springs' and vertices' numbers: 448 vertices of 12 floats, 2,900 springs of 5.
  EXPECT_GT(direct.memory_bytes(), 448U * 48U + 2900U * 20U);
  EXPECT_LT(direct.memory_bytes(), 10'000'000U);
}

TEST(DirectMethod, RefusesAGripWithoutASize) {
  DirectOptions options;
  options.patch_radius_m = 0.0;
  EXPECT_THROW(DirectMethod(block(), options), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
