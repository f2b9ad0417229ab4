// SPDX-License-Identifier: Apache-2.0
// The same for an object that moves by itself: its stiffness is predicted, its inertia and its
// dampers are not.

#include <iostream>

#include "simulator/mesh/scene.h"
#include "simulator/touch/dynamic_contact.h"
#include "simulator/workers/query_solver.h"
#include "tests/integration/first_touch_bench.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

TEST(DynamicTouch, StiffnessAloneIsBetterThanNoForceUntilTheAnswer) {
  const simulator::Scene scene = simulator::make_scene("jelly");
  int phase = 4;
  for (const double x_m : {-0.02, 0.0, 0.02}) {
    const Vector3d touch_W = scene.mesh.top_W + Vector3d(x_m, 0.5 * x_m + 0.003, 0.0);
    const auto tool = simulator::make_dynamic_contact(scene, {}, {});
    const auto reference = simulator::make_dynamic_contact(scene, {}, {});
    auto surface = simulator::LocalSurface::make(scene.mesh, {}).value();
    simulator::QuerySolver solver(scene, {});
    FirstTouchBench bench{
        *tool, *reference, surface, [&](const Vector3d& expected_W, link::SurfacePatch& patch) {
          const auto held =
              solver.answer({.touching = true, .point_W = expected_W, .position_W = expected_W});
          const Eigen::Matrix3f k = held.equilibrium.stiffness_W.cast<float>();
          patch.has_stiffness = true;
          patch.stiffness_W_N_per_m = {k(0, 0), k(1, 1), k(2, 2), k(0, 1), k(0, 2), k(1, 2)};
        }};
    const TouchErrors errors = bench.touch_at(touch_W, {}, phase);
    phase += 5;
    EXPECT_EQ(errors.cycles_to_force, 0);
    EXPECT_LT(errors.unanswered_percent, 80.0);
    EXPECT_LT(errors.with_percent, 0.85 * errors.without_percent);
    std::cout << "jelly at " << x_m << " m: " << errors.with_percent << " % with, "
              << errors.without_percent << " % without; " << errors.unanswered_percent
              << " % in the " << errors.unanswered_cycles << " cycles until the answer\n";
  }
}

}  // namespace
}  // namespace forcegrid::servo
