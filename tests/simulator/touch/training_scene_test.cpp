// SPDX-License-Identifier: Apache-2.0
// The scene training: one simulator, a tool that touches each of its organs.
#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/reference/reference_solution.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/solver_contact.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kRate_Hz = 30.0;
constexpr double kDepth_m = 0.003;

struct Touched {
  const char* what;
  Vector3d top_W;
  double least_N_per_m;  // of the force over the depth
  double most_N_per_m;
};

const std::array<Touched, 4> kOrgans{{{"stomach", {0.0, 0.0, 0.0}, 70.0, 110.0},
                                      {"spleen", {0.060, 0.0, -0.010}, 180.0, 260.0},
                                      {"gallbladder", {-0.058, 0.030, -0.012}, 60.0, 100.0},
                                      {"vertebra", {-0.058, -0.030, -0.006}, 900.0, 1100.0}}};

// From 5 mm above the top to a press of 3 mm.
StickyContact::Answer pressed(ToolContact& contact, const Vector3d& top_W) {
  contact.reset();
  StickyContact::Answer answer;
  for (double z_m = 0.005; z_m > -kDepth_m + 1e-9; z_m -= 0.0005) {
    answer = contact.step(top_W + Vector3d(0.0, 0.0, z_m));
  }
  return contact.step(top_W + Vector3d(0.0, 0.0, -kDepth_m));
}

TEST(TrainingScene, TheToolFeelsEveryOrgan) {
  const Scene scene = make_scene("training");
  const ToolOptions tool;
  const SolverChoice solver =
      choose_solver({}, scene.mesh.rest_position_W.size(), kRate_Hz, SolverOptions{});
  const auto contact = make_solver_contact(scene, solver, tool, kRate_Hz);
  for (const Touched& organ : kOrgans) {
    SCOPED_TRACE(organ.what);
    const StickyContact::Answer answer = pressed(*contact, organ.top_W);
    EXPECT_TRUE(answer.in_contact);
    EXPECT_TRUE(answer.equilibrium.converged);
    const double felt_N_per_m = answer.equilibrium.force_W.z() / kDepth_m;
    EXPECT_GT(felt_N_per_m, organ.least_N_per_m);
    EXPECT_LT(felt_N_per_m, organ.most_N_per_m);
  }
}

TEST(TrainingScene, TheStomachIsThePapersAndDoesNotFeelTheOthers) {
  const Scene training = make_scene("training");
  const Scene alone = make_scene("stomach");
  const std::vector<Vector3d> path_W{{0.0, 0.0, 0.0},
                                     {0.0, 0.0, -0.004},
                                     {0.004, 0.0, -0.006},
                                     {0.0, 0.003, 0.0},
                                     {0.0, 0.0, 0.010}};
  ReferenceOptions options;
  options.patch_radius_m = alone.patch_radius_m;
  const auto among = simulate_reference(training.mesh, path_W, options).forces_W;
  const auto by_itself = simulate_reference(alone.mesh, path_W, options).forces_W;
  EXPECT_EQ(training.patch_radius_m, alone.patch_radius_m);
  for (std::size_t i = 0; i < path_W.size(); ++i) {
    EXPECT_LT((among[i] - by_itself[i]).norm(), 1e-5) << i;
  }
  EXPECT_GT(by_itself.back().norm(), 0.5);
}

}  // namespace
}  // namespace forcegrid::simulator
