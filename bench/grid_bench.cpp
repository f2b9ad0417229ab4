// Grid query and fill against their peers, on the paper's grid of 50 x 50 x 50 vertices.

#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "bench/openvdb_peer.h"
#include "bench/ratios.h"
#include "forcegrid/force_grid.h"

namespace forcegrid::bench {
namespace {

constexpr int kVertices = 50;
constexpr int kPositions = 4096;
constexpr double kSpacing_m = 0.16 / (kVertices - 1);
constexpr double kRadius_m = 0.16 / 6;
constexpr unsigned kSeed = 11;

GridGeometry paper_geometry() {
  GridGeometry geometry;
  geometry.max_W.setConstant(0.16);
  geometry.cells.setConstant(kVertices - 1);
  return geometry;
}

const std::vector<std::array<double, 3>>& index_positions() {
  static const auto positions = [] {
    std::mt19937 random(kSeed);
    std::uniform_real_distribution<double> index(0.0, kVertices - 1.001);
    std::vector<std::array<double, 3>> result(kPositions);
    for (auto& p : result) {
      p = {index(random), index(random), index(random)};
    }
    return result;
  }();
  return positions;
}

const std::vector<Eigen::Vector3d>& metric_positions() {
  static const auto positions = [] {
    std::vector<Eigen::Vector3d> result;
    for (const auto& p : index_positions()) {
      result.push_back(Eigen::Vector3d(p[0], p[1], p[2]) * kSpacing_m);
    }
    return result;
  }();
  return positions;
}

void forcegrid_query(benchmark::State& state) {
  ForceGrid grid(paper_geometry(), {kRadius_m, 0.001});
  for (const auto& p : metric_positions()) {
    ForceGrid::Fill fill;
    if (grid.begin_fill(p, Eigen::Vector3d(1.0, std::sin(p.x() * 100), 3.0), fill)) {
      grid.continue_fill(fill, 1 << 20);
    }
  }
  for (auto _ : state) {
    double x = 0.0;
    double y = 0.0;
    double z = 0.0;
    for (const Eigen::Vector3d& p : metric_positions()) {
      const ForceEstimate estimate = grid.sample(p);
      x += estimate.force_W.x();
      y += estimate.force_W.y();
      z += estimate.force_W.z();
    }
    benchmark::DoNotOptimize(x + y + z);
  }
  state.SetItemsProcessed(state.iterations() * kPositions);
}
BENCHMARK(forcegrid_query);

// The least a trilinear read can do: eight aligned loads of four floats and their weighted sum.
// No bounds, no status, positions already in cells and single precision.
void bare_trilinear_query(benchmark::State& state) {
  using Float4 = float __attribute__((vector_size(16)));
  std::vector<Float4> data(kVertices * kVertices * kVertices);
  for (std::size_t i = 0; i < data.size(); ++i) {
    const float value = std::sin(static_cast<float>(i));
    data[i] = Float4{value, 2 * value, 3 * value, 1.0F};
  }
  std::vector<std::array<float, 3>> positions;
  for (const auto& p : index_positions()) {
    positions.push_back(
        {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
  }
  for (auto _ : state) {
    Float4 sum{};
    for (const auto& p : positions) {
      const int i = static_cast<int>(p[0]);
      const int j = static_cast<int>(p[1]);
      const int k = static_cast<int>(p[2]);
      const float x = p[0] - static_cast<float>(i);
      const float y = p[1] - static_cast<float>(j);
      const float z = p[2] - static_cast<float>(k);
      const Float4* corner = &data[static_cast<std::size_t>((i * kVertices + j) * kVertices + k)];
      const Float4* next = corner + kVertices * kVertices;
      const auto mix = [](Float4 a, Float4 b, float t) { return a + t * (b - a); };
      const Float4 low =
          mix(mix(corner[0], corner[1], z), mix(corner[kVertices], corner[kVertices + 1], z), y);
      const Float4 high =
          mix(mix(next[0], next[1], z), mix(next[kVertices], next[kVertices + 1], z), y);
      sum += mix(low, high, x);
    }
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * kPositions);
}
BENCHMARK(bare_trilinear_query);

void openvdb_box_sampler_query(benchmark::State& state) {
  const OpenVdbGrid grid(kVertices);
  for (auto _ : state) {
    auto sum = grid.sample_all(index_positions().data(), kPositions);
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * kPositions);
}
BENCHMARK(openvdb_box_sampler_query);

// All vertices of the grid that a fill at `centre` can reach.
std::vector<Eigen::Vector3d> vertices_around(const Eigen::Vector3d& centre) {
  std::vector<Eigen::Vector3d> result;
  for (int i = 0; i < kVertices; ++i) {
    for (int j = 0; j < kVertices; ++j) {
      for (int k = 0; k < kVertices; ++k) {
        const Eigen::Vector3d vertex = Eigen::Vector3d(i, j, k) * kSpacing_m;
        if ((vertex - centre).cwiseAbs().maxCoeff() <= 2.0 * kRadius_m) {
          result.push_back(vertex);
        }
      }
    }
  }
  return result;
}

// One sample spread over its sphere at the grid's centre, r = 1/6 of the workspace.
void forcegrid_fill_vertex(benchmark::State& state) {
  ForceGrid grid(paper_geometry(), {kRadius_m, 0.001});
  Eigen::Vector3d at = Eigen::Vector3d::Constant(0.08);
  // Items are the vertices that change, those within r; a fill visits some more on its way.
  std::int64_t within_r = 0;
  for (const Eigen::Vector3d& vertex : vertices_around(at)) {
    within_r += (vertex - at).norm() < kRadius_m ? 1 : 0;
  }
  for (auto _ : state) {
    at.x() = 0.160 - at.x();
    ForceGrid::Fill fill;
    if (grid.begin_fill(at, Eigen::Vector3d(1, 2, 3), fill)) {
      grid.continue_fill(fill, 1 << 20);
    }
  }
  state.SetItemsProcessed(state.iterations() * within_r);
}
BENCHMARK(forcegrid_fill_vertex);

// The least an update of the same vertices can do: read, add, write, in the same order.
void bare_read_modify_write_vertex(benchmark::State& state) {
  using Float4 = float __attribute__((vector_size(16)));
  std::vector<Float4> data(kVertices * kVertices * kVertices);
  std::vector<std::pair<double, std::ptrdiff_t>> order;
  constexpr int kReach = static_cast<int>(kRadius_m / kSpacing_m);
  for (int i = -kReach; i <= kReach; ++i) {
    for (int j = -kReach; j <= kReach; ++j) {
      for (int k = -kReach; k <= kReach; ++k) {
        const double d = std::sqrt(static_cast<double>(i * i + j * j + k * k)) * kSpacing_m;
        if (d < kRadius_m) {
          order.emplace_back(d, (i * kVertices + j) * kVertices + k);
        }
      }
    }
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::ptrdiff_t> offsets;
  for (const auto& entry : order) {
    offsets.push_back(entry.second);
  }
  const Float4 force{1.0F, 2.0F, 3.0F, 0.5F};
  Float4* centre = &data[(25 * kVertices + 25) * kVertices + 25];
  for (auto _ : state) {
    for (const std::ptrdiff_t offset : offsets) {
      centre[offset] += force;
    }
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(offsets.size()));
}
BENCHMARK(bare_read_modify_write_vertex);

const bool registered = [] {
  report_time("bare_trilinear_query", "the yardstick");
  report_time("forcegrid_query", "");
  report_time("forcegrid_fill_vertex", "<= 4 ns");
  report_ratio("forcegrid_query", "openvdb_box_sampler_query", "<= 0.2");
  report_ratio("forcegrid_query", "bare_trilinear_query", "<= 1.5");
  report_ratio("forcegrid_fill_vertex", "bare_read_modify_write_vertex", "(stated)");
  return true;
}();

}  // namespace
}  // namespace forcegrid::bench
