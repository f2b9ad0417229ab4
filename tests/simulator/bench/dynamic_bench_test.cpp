// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/dynamic_bench.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/mesh/tetrahedra.h"
#include "tests/simulator/element_block.h"
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

TEST(DynamicBench, EnergyOfElementsIsTheWorkThatTheirForcesTake) {
  for (const ElementModel model : kElementModels) {
    const SpringMesh mesh = element_block({2, 2, 2}, 0.02, soft(model, 0.4));
    std::vector<Vector3d> way_m;  // of each free vertex, another one
    for (std::size_t i = 0; i < mesh.rest_position_W.size(); ++i) {
      const auto n = static_cast<double>(i);
      way_m.emplace_back(0.004 * Vector3d(std::sin(n), std::cos(2.0 * n), std::sin(3.0 * n)));
    }
    const auto at = [&](double part) {
      std::vector<Vector3d> place_W = mesh.rest_position_W;
      for (std::size_t i = 0; i < place_W.size(); ++i) {
        place_W[i] += part * way_m[i];
      }
      return place_W;
    };
    double work_J = 0.0;
    constexpr int kParts = 1000;
    for (int k = 0; k < kParts; ++k) {
      const std::vector<Vector3d> force_N = vertex_forces_W(mesh, at((k + 0.5) / kParts));
      for (std::size_t i = 0; i < way_m.size(); ++i) {
        work_J -= force_N[i].dot(way_m[i]) / kParts;
      }
    }
    const double energy = energy_J(mesh, at(1.0), {}) - energy_J(mesh, at(0.0), {});
    EXPECT_GT(energy, 1e-4);
    EXPECT_NEAR(energy, work_J, 1e-5 * work_J) << name_of(model);
  }
}

TEST(DynamicBench, ABlockOfElementsLosesEnergyWithEveryStepAfterItIsLetGo) {
  Scene scene;
  scene.name = "elements";
  scene.mesh = element_block({5, 5, 4}, 0.012, soft(ElementModel::kNeoHookean, 0.4));
  scene.mesh.mass_kg = element_masses_kg(scene.mesh);
  const std::vector<Vector3d> motion_W{{0, 0, -0.001}, {0.001, 0, -0.002}, {0.002, 0, -0.003}};
  for (const DynamicRow& row : bench_dynamic(scene, motion_W, 30.0, {})) {
    SCOPED_TRACE(row.step_s);
    EXPECT_GT(row.released_J, 1e-5);
    EXPECT_LT(row.largest_rise_percent, 0.1);
    EXPECT_LT(row.after_100ms_percent, 100.0);
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
