// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <string>

#include "simulator/mesh/scene.h"
#include "simulator/rivals/rivals.h"
#include "tests/support/allocation_count.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

// Those that solve the object allocate when they take hold, as `direct` does on its own thread.
bool solves(const std::string& name) { return name == "coarse-mesh" || name == "two-rates"; }

TEST(Rivals, AllocateNothingInTheCycle) {
  const SpringMesh mesh = make_scene("small").mesh;
  RivalTables tables([] { return make_coarser_mesh("small"); });
  for (const Rival& rival : rivals()) {
    SCOPED_TRACE(rival.name);
    const MadeRival made = tables.make(rival.name, mesh, 0.012);
    const bool allocates_to_hold = solves(rival.name);
    if (allocates_to_hold) {
      made.method->contact_made(1, Vector3d::Zero());
      made.method->work(1);
    }
    double sum_N = 0.0;
    const testing::AllocationCount count;
    if (!allocates_to_hold) {
      made.method->contact_made(1, Vector3d::Zero());
    }
    for (int cycle = 1; cycle <= 30; ++cycle) {
      const Vector3d position_W(1e-4 * cycle, 0.0, 2e-4 * cycle);
      made.method->take_sample({});
      made.method->observe(0.002 * cycle, position_W);
      sum_N += made.method->force(0.002 * cycle, position_W).force_W.z();
      made.method->work(8);
    }
    made.method->contact_lost();
    EXPECT_EQ(count.value(), 0U);
    EXPECT_LT(sum_N, -0.1);
  }
}

}  // namespace
}  // namespace forcegrid::simulator
