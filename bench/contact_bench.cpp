// SPDX-License-Identifier: Apache-2.0
// Cost of a servo cycle's query of the local surface near the tool.

#include <benchmark/benchmark.h>

#include <cstdint>
#include <random>
#include <vector>

#include "bench/ratios.h"
#include "contact/near_patch.h"
#include "contact/tool_shape.h"

namespace forcegrid::bench {
namespace {

using contact::Capsule;
using contact::NearPatch;
using Eigen::Vector3d;

constexpr std::size_t kPositions = 256;
constexpr double kMargin_m = 0.02;  // FirstTouch::kMargin_m

// Nearly the largest local surface: 19 vertices, 2.5 mm apart, and 22 triangles of a wavy surface.
NearPatch full_patch() {
  std::vector<NearPatch::Vertex> vertices;
  for (int i = 0; i < 19; ++i) {
    vertices.push_back({0.0025 * (i % 5 - 2), 0.0025 * (i / 5 - 2), 0.0005 * (i % 3)});
  }
  std::vector<NearPatch::Triangle> triangles;
  for (std::uint8_t i = 0; i + 6 < 19; ++i) {
    if (i % 5 < 4) {
      const auto at = [i](int step) { return static_cast<std::uint8_t>(i + step); };
      triangles.push_back({at(0), at(1), at(6)});
      triangles.push_back({at(0), at(6), at(5)});
    }
  }
  NearPatch patch;
  if (!patch.set(vertices, triangles)) {
    return {};
  }
  return patch;
}

std::vector<Vector3d> positions(double low_m, double high_m) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> across_m(-0.004, 0.004);
  std::uniform_real_distribution<double> up_m(low_m, high_m);
  std::vector<Vector3d> positions_W(kPositions);
  for (Vector3d& position_W : positions_W) {
    position_W = {across_m(random), across_m(random), up_m(random)};
  }
  return positions_W;
}

void look(benchmark::State& state, const Capsule& tool, double low_m, double high_m) {
  const NearPatch patch = full_patch();
  const std::vector<Vector3d> positions_W = positions(low_m, high_m);
  for (auto _ : state) {
    for (const Vector3d& position_W : positions_W) {
      auto clearance = patch.clearance(tool, position_W, kMargin_m);
      benchmark::DoNotOptimize(clearance);
    }
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(kPositions));
}

void near_patch_of_a_point(benchmark::State& state) { look(state, {}, -0.001, 0.01); }
BENCHMARK(near_patch_of_a_point);

void near_patch_of_a_sphere(benchmark::State& state) {
  const Vector3d centre_T(0.0, 0.0, 0.008);
  look(state, {centre_T, centre_T, 0.008}, -0.001, 0.01);
}
BENCHMARK(near_patch_of_a_sphere);

void near_patch_of_a_capsule(benchmark::State& state) {
  const Vector3d lower_T(0.0, 0.0, 0.008);
  look(state, {lower_T, lower_T + Vector3d(0.0, 0.0, 0.04), 0.008}, -0.001, 0.01);
}
BENCHMARK(near_patch_of_a_capsule);

// Two queries, one for each jaw.
void near_patch_of_a_grasper(benchmark::State& state) {
  const NearPatch patch = full_patch();
  const contact::ToolShape tool = contact::ToolShape::grasper(0.004, 0.03, 0.7);
  const std::vector<Vector3d> positions_W = positions(-0.003, 0.01);
  for (auto _ : state) {
    for (const Vector3d& position_W : positions_W) {
      for (const Capsule& jaw : tool.parts()) {
        auto clearance = patch.clearance(jaw, position_W, kMargin_m);
        benchmark::DoNotOptimize(clearance);
      }
    }
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(kPositions));
}
BENCHMARK(near_patch_of_a_grasper);

void near_patch_out_of_reach(benchmark::State& state) { look(state, {}, 0.03, 0.04); }
BENCHMARK(near_patch_out_of_reach);

const bool registered = [] {
  for (const char* name :
       {"near_patch_of_a_point", "near_patch_of_a_sphere", "near_patch_of_a_capsule",
        "near_patch_of_a_grasper", "near_patch_out_of_reach"}) {
    report_ratio(name, "bare_trilinear_query", "-");
  }
  return true;
}();

}  // namespace
}  // namespace forcegrid::bench
