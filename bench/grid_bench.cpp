// SPDX-License-Identifier: Apache-2.0
// Grid query and fill compared with their peers, on the paper's grid of 50 x 50 x 50 vertices.

#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "bench/openvdb_peer.h"
#include "bench/ratios.h"
#include "evaluation/judge/baseline_cost.h"
#include "forcegrid/grid/force_grid.h"
#include "forcegrid/grid/mls_grid.h"

namespace forcegrid::bench {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

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

constexpr int kEnough = 1 << 20;  // units of work for a whole fill

RadialWeight paper_weighting() {
  RadialWeight weighting;
  weighting.influence_radius_m = kRadius_m;
  weighting.mean_spacing_m = kSpacing_m;
  return weighting;
}

const Vector3i kVerticesAnAxis = Vector3i::Constant(kVertices);

using DenseGrid = ForceGrid<DenseStorage<ForceSegment>>;
using BlockGrid = ForceGrid<BlockStorage<ForceSegment>>;
using MomentGrid = MlsGrid<DenseStorage<MomentSegment>>;

DenseGrid dense_grid(Instructions instructions = Instructions::kBest) {
  return {paper_geometry(), paper_weighting(), DenseStorage<ForceSegment>(kVerticesAnAxis, false),
          Interpolation::kTrilinear, instructions};
}

BlockGrid block_grid() {
  return {paper_geometry(), paper_weighting(),
          BlockStorage<ForceSegment>(kVerticesAnAxis, false,
                                     BlockStorage<ForceSegment>::block_count(kVerticesAnAxis))};
}

MomentGrid moment_grid(Instructions instructions = Instructions::kBest) {
  return {paper_geometry(), paper_weighting(), 1e-5,
          DenseStorage<MomentSegment>(kVerticesAnAxis, false), instructions};
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

const std::vector<Vector3d>& metric_positions() {
  static const auto positions = [] {
    std::vector<Vector3d> result;
    for (const auto& p : index_positions()) {
      result.push_back(Vector3d(p[0], p[1], p[2]) * kSpacing_m);
    }
    return result;
  }();
  return positions;
}

template <typename Grid>
void fill(Grid& grid, const Vector3d& position_W, const Vector3d& force_W) {
  Sample sample;
  sample.position_W = position_W;
  sample.force_W = force_W;
  GridFill one = grid.begin_fill(sample, false);
  grid.continue_fill(one, kEnough);
}

// Queries a completely filled grid at random positions.
template <typename Grid, typename Read>
void query(benchmark::State& state, Grid grid, Read read) {
  for (const auto& p : metric_positions()) {
    fill(grid, p, Vector3d(1.0, std::sin(p.x() * 100), 3.0));
  }
  for (auto _ : state) {
    double x = 0.0;
    double y = 0.0;
    double z = 0.0;
    for (const Vector3d& p : metric_positions()) {
      const ForceEstimate estimate = read(grid, p);
      x += estimate.force_W.x();
      y += estimate.force_W.y();
      z += estimate.force_W.z();
    }
    benchmark::DoNotOptimize(x + y + z);
  }
  state.SetItemsProcessed(state.iterations() * kPositions);
}

void forcegrid_query(benchmark::State& state) {
  query(state, dense_grid(),
        [](const DenseGrid& grid, const Vector3d& p) { return grid.sample(p); });
}
BENCHMARK(forcegrid_query);

void forcegrid_query_blocks(benchmark::State& state) {
  query(state, block_grid(),
        [](const BlockGrid& grid, const Vector3d& p) { return grid.sample(p); });
}
BENCHMARK(forcegrid_query_blocks);

void forcegrid_query_tricubic(benchmark::State& state) {
  query(state, dense_grid(),
        [](const DenseGrid& grid, const Vector3d& p) { return grid.sample_tricubic(p); });
}
BENCHMARK(forcegrid_query_tricubic);

void forcegrid_mls_query(benchmark::State& state) {
  query(state, moment_grid(),
        [](const MomentGrid& grid, const Vector3d& p) { return grid.read(p); });
}
BENCHMARK(forcegrid_mls_query);

void forcegrid_mls_query_scalar(benchmark::State& state) {
  query(state, moment_grid(Instructions::kScalar),
        [](const MomentGrid& grid, const Vector3d& p) { return grid.read(p); });
}
BENCHMARK(forcegrid_mls_query_scalar);

void bare_trilinear_query(benchmark::State& state) {
  const evaluation::BareTrilinearGrid grid;
  static_assert(evaluation::BareTrilinearGrid::kVertices == kVertices);
  std::vector<std::array<float, 3>> positions;
  for (const auto& p : index_positions()) {
    positions.push_back(
        {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
  }
  for (auto _ : state) {
    evaluation::BareTrilinearGrid::Float4 sum{};
    for (const auto& p : positions) {
      sum += grid.read(p);
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
std::vector<Vector3d> vertices_around(const Vector3d& centre) {
  std::vector<Vector3d> result;
  for (int i = 0; i < kVertices; ++i) {
    for (int j = 0; j < kVertices; ++j) {
      for (int k = 0; k < kVertices; ++k) {
        const Vector3d vertex = Vector3d(i, j, k) * kSpacing_m;
        if ((vertex - centre).cwiseAbs().maxCoeff() <= 2.0 * kRadius_m) {
          result.push_back(vertex);
        }
      }
    }
  }
  return result;
}

// Spreads one sample after the other over its sphere at the grid's centre, r = 1/6 of the
// workspace.
template <typename Grid>
void fill_vertex(benchmark::State& state, Grid grid) {
  Vector3d at = Vector3d::Constant(0.08);
  // Items are the vertices within r, which change; a fill visits some others, too.
  std::int64_t within_r = 0;
  for (const Vector3d& vertex : vertices_around(at)) {
    within_r += (vertex - at).norm() < kRadius_m ? 1 : 0;
  }
  for (auto _ : state) {
    at.x() = 0.160 - at.x();
    fill(grid, at, Vector3d(1, 2, 3));
  }
  state.SetItemsProcessed(state.iterations() * within_r);
}

void forcegrid_fill_vertex(benchmark::State& state) { fill_vertex(state, dense_grid()); }
BENCHMARK(forcegrid_fill_vertex);

void forcegrid_fill_vertex_scalar(benchmark::State& state) {
  fill_vertex(state, dense_grid(Instructions::kScalar));
}
BENCHMARK(forcegrid_fill_vertex_scalar);

void forcegrid_fill_vertex_blocks(benchmark::State& state) { fill_vertex(state, block_grid()); }
BENCHMARK(forcegrid_fill_vertex_blocks);

void forcegrid_mls_fill_vertex(benchmark::State& state) { fill_vertex(state, moment_grid()); }
BENCHMARK(forcegrid_mls_fill_vertex);

// A minimal update of the same vertices: read, add, write, in the same order.
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
  report_time("bare_trilinear_query", "the baseline");
  report_time("forcegrid_query", "<= 8 ns");
  report_time("forcegrid_query_tricubic", "");
  report_time("forcegrid_mls_query", "");
  report_time("forcegrid_fill_vertex", "<= 2 ns");
  report_time("forcegrid_mls_fill_vertex", "");
  report_ratio("forcegrid_query", "openvdb_box_sampler_query", "<= 0.2");
  report_ratio("forcegrid_query", "bare_trilinear_query", "<= 1.5");
  report_ratio("forcegrid_query_blocks", "forcegrid_query", "<= 1.5");
  report_ratio("forcegrid_mls_query", "forcegrid_mls_query_scalar", "");
  report_ratio("forcegrid_fill_vertex", "bare_read_modify_write_vertex", "(stated)");
  report_ratio("forcegrid_fill_vertex", "forcegrid_fill_vertex_scalar", "");
  report_ratio("forcegrid_fill_vertex_blocks", "forcegrid_fill_vertex", "");
  return true;
}();

}  // namespace
}  // namespace forcegrid::bench
