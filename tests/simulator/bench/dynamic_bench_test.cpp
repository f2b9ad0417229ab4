// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/dynamic_bench.h"

#include <gtest/gtest.h>

#include <cmath>

#include "simulator/mesh/error.h"
#include "tests/simulator/little_jelly.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

TEST(DynamicBench, EnergyIsTheWorkThatEachLawTakes) {
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, 0}, {0, 0, 0.1}};
  mesh.fixed = {1, 0};
  mesh.springs = {{0, 1, 40.0}};
  mesh.mass_kg = {0.1, 0.2};
  mesh.home_stiffness_N_per_m = {0.0, 10.0};
  for (const SpringLaw& law :
       {SpringLaw{}, SpringLaw{.cubic_coefficient = 5.0}, SpringLaw{.exponent = 4.0}}) {
    mesh.laws = {law};
    // The midpoint rule for the force along the way.
    double work_J = 0.0;
    constexpr int kParts = 2000;
    constexpr double kWay_m = 0.03;
    for (int i = 0; i < kParts; ++i) {
      const double z_m = 0.1 + kWay_m * (i + 0.5) / kParts;
      work_J -= vertex_forces_W(mesh, {{0, 0, 0}, {0, 0, z_m}})[1].z() * kWay_m / kParts;
    }
    const double energy = energy_J(mesh, {{0, 0, 0}, {0, 0, 0.1 + kWay_m}}, {});
    EXPECT_NEAR(energy, work_J, 1e-6 * work_J);
    EXPECT_NEAR(energy_J(mesh, {{0, 0, 0}, {0, 0, 0.1 + kWay_m}}, {{0, 0, 0}, {3, 0, 4}}) - energy,
                0.5 * 0.2 * 25.0, 1e-9);
  }
}

TEST(DynamicBench, AJellyComesToItsEquilibriumAndLosesEnergyWithEveryStep) {
  const Scene scene = testing::little_jelly();
  const std::vector<Vector3d> motion_W{{0, 0, 0.0005}, {0.0005, 0, 0.001}, {0.001, 0, 0.0015}};
  const std::vector<DynamicRow> rows = bench_dynamic(scene, motion_W, 30.0, {});
  ASSERT_EQ(rows.size(), 4U);
  for (const DynamicRow& row : rows) {
    SCOPED_TRACE(row.step_s);
    EXPECT_EQ(row.steps, 3 * static_cast<std::size_t>(std::ceil(1.0 / 30.0 / row.step_s - 1e-6)));
    EXPECT_EQ(row.unconverged, 0.0);
    EXPECT_LT(row.static_error_percent, 0.1);
    EXPECT_GT(row.released_J, 1e-6);
    EXPECT_LT(row.after_100ms_percent, 90.0);
    EXPECT_LT(row.largest_rise_percent, 1e-3);
  }
  EXPECT_LT(rows.back().after_100ms_percent, rows.front().after_100ms_percent)
      << "longer steps damp more";
  EXPECT_TRUE(bench_dynamic(make_scene("small"), motion_W, 30.0, {}).empty()) << "no masses";
  EXPECT_THROW(bench_dynamic(scene, {}, 30.0, {}), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
