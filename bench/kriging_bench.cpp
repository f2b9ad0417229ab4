// SPDX-License-Identifier: Apache-2.0
// Query and fit of the kriging field, compared with the bare trilinear read.

#include <benchmark/benchmark.h>

#include <array>
#include <random>
#include <vector>

#include "bench/ratios.h"
#include "forcegrid/kriging/ensemble_method.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/kriging_grid_method.h"
#include "forcegrid/kriging/kriging_method.h"

namespace forcegrid::bench {
namespace {

using kriging::DictionaryField;
using kriging::FieldSettings;
using kriging::Observation;

constexpr unsigned kSeed = 11;
constexpr int kPositions = 1024;
const kriging::History kNoHistory = kriging::History::Zero();

std::vector<Eigen::Vector3d> positions(int count, double size_m) {
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> uniform(-size_m, size_m);
  std::vector<Eigen::Vector3d> result;
  for (int i = 0; i < count; ++i) {
    result.emplace_back(uniform(random), uniform(random), uniform(random));
  }
  return result;
}

// A hardening spring: something smooth to fit.
Eigen::Vector3d force_N(const Eigen::Vector3d& p) {
  return -200.0 * (1.0 + 500.0 * p.squaredNorm()) * p;
}

template <typename FieldType>
void fill(FieldType& field) {
  for (const Eigen::Vector3d& p : positions(40, 0.015)) {
    Observation o;
    o.position_m = p;
    o.force_N = force_N(p);
    field.take(o);
  }
}

// A sample and all work that it causes.
void tell(ForceMethod& method, double time_s, const Eigen::Vector3d& position_W) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = position_W;
  sample.force_W = force_N(position_W);
  method.observe(time_s, position_W);
  method.take_sample(sample);
  while (method.work(1 << 30) > 0) {
  }
}

// @param read position -> force.
template <typename Read>
void time_reads(benchmark::State& state, Read read) {
  const auto at = positions(kPositions, 0.02);
  for (auto _ : state) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : at) {
      sum += read(p);
    }
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * kPositions);
}

void kriging_read_32(benchmark::State& state) {
  DictionaryField<float, 32, 0> field{FieldSettings{}};
  fill(field);
  time_reads(state, [&](const Eigen::Vector3d& p) { return field.read(p, kNoHistory).force_N; });
}
BENCHMARK(kriging_read_32);

// The same sum by plain loops in double precision.
void kriging_read_32_scalar(benchmark::State& state) {
  DictionaryField<double, 32, 0> field{FieldSettings{}};
  fill(field);
  const auto at = positions(kPositions, 0.02);
  const kriging::RadialTerms<double> terms = field.radial_terms();
  for (auto _ : state) {
    double sum = 0.0;
    for (const Eigen::Vector3d& p : at) {
      sum += kriging::radial_sum_scalar(terms, p.data()).force_N[0];
    }
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * kPositions);
}
BENCHMARK(kriging_read_32_scalar);

// As the loop calls it: virtual, with contact, hand-over, uncertainty and status.
void kriging_force(benchmark::State& state) {
  KrigingMethod method(KrigingMethod::Kind::kForceOnly, {});
  method.contact_made(1, Eigen::Vector3d::Zero());
  double time_s = 0.0;
  for (const Eigen::Vector3d& p : positions(40, 0.015)) {
    tell(method, time_s += 0.033, p);
  }
  time_reads(state, [&](const Eigen::Vector3d& p) { return method.force(time_s, p).force_W; });
}
BENCHMARK(kriging_force);

// Samples along a path beyond the dictionary's capacity: each is committed and evicts another.
template <typename Method, typename Method::Kind kKind>
void take_samples(benchmark::State& state) {
  Method method(kKind, {});
  method.contact_made(1, Eigen::Vector3d::Zero());
  double time_s = 0.0;
  std::size_t next = 0;
  const auto at = positions(kPositions, 0.02);
  for (auto _ : state) {
    const Eigen::Vector3d& p = at[next++ % kPositions];
    for (int cycle = 1; cycle < 8; ++cycle) {
      method.observe(time_s += 0.004, p);
    }
    tell(method, time_s += 0.004, p);
  }
  state.SetItemsProcessed(state.iterations());
}
void kriging_sample(benchmark::State& state) {
  take_samples<KrigingMethod, KrigingMethod::Kind::kForceOnly>(state);
}
BENCHMARK(kriging_sample);
void kriging_bank_sample(benchmark::State& state) {
  take_samples<EnsembleMethod, EnsembleMethod::Kind::kKriging>(state);
}
BENCHMARK(kriging_bank_sample);
void kriging_store_sample(benchmark::State& state) {
  take_samples<KrigingMethod, KrigingMethod::Kind::kStore>(state);
}
BENCHMARK(kriging_store_sample);

// The grid alone: eight vertices of force and stiffness.
void posterior_grid_read(benchmark::State& state) {
  PosteriorGrid grid(Eigen::Vector3d::Constant(-0.032), Eigen::Vector3i::Constant(16), 0.004, 30);
  for (int x = 0; x <= 16; ++x) {
    for (int y = 0; y <= 16; ++y) {
      for (int z = 0; z <= 16; ++z) {
        const Eigen::Vector3i vertex(x, y, z);
        const Eigen::Matrix3d j = -200.0 * Eigen::Matrix3d::Identity();
        grid.write(vertex, {force_N(grid.position_m(vertex)), j, 1e-3}, 1);
      }
    }
  }
  time_reads(state, [&](const Eigen::Vector3d& p) { return grid.read(p).force_N; });
}
BENCHMARK(posterior_grid_read);

KrigingGridMethod kriging_grid() {
  MethodOptions options;
  options.grid.min_W.setConstant(-0.08);
  options.grid.max_W.setConstant(0.08);
  return KrigingGridMethod(options);
}

// As the loop calls it, entirely on the known part of the grid.
void forcegrid_kriging_force(benchmark::State& state) {
  KrigingGridMethod method = kriging_grid();
  method.contact_made(1, Eigen::Vector3d::Zero());
  double time_s = 0.0;
  for (const Eigen::Vector3d& p : positions(kPositions, 0.02)) {
    tell(method, time_s += 0.033, p);
  }
  time_reads(state, [&](const Eigen::Vector3d& p) { return method.force(time_s, p).force_W; });
}
BENCHMARK(forcegrid_kriging_force);

// Each sample at another place, so that all vertices around it are written.
void forcegrid_kriging_sample(benchmark::State& state) {
  KrigingGridMethod method = kriging_grid();
  method.contact_made(1, Eigen::Vector3d::Zero());
  double time_s = 0.0;
  std::size_t next = 0;
  const auto at = positions(kPositions, 0.02);
  for (auto _ : state) {
    const Eigen::Vector3d& p = at[next++ % kPositions];
    tell(method, time_s += 0.033, p);
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(forcegrid_kriging_sample);

const bool registered = [] {
  report_time("kriging_read_32", "<= 25 ns");
  report_time("kriging_read_32_scalar", "<= 250 ns");
  report_time("kriging_force", "");
  report_time("kriging_sample", "<= 30 us");
  report_time("kriging_bank_sample", "<= 250 us");
  report_time("kriging_store_sample", "<= 100 us");
  report_time("posterior_grid_read", "");
  report_time("forcegrid_kriging_force", "<= 25 ns");
  report_time("forcegrid_kriging_sample", "");
  report_ratio("posterior_grid_read", "bare_trilinear_query", "<= 6.1");
  report_ratio("forcegrid_kriging_force", "bare_trilinear_query", "<= 6.1");
  report_ratio("kriging_read_32", "bare_trilinear_query", "<= 6.1");
  report_ratio("kriging_read_32_scalar", "bare_trilinear_query", "<= 61");
  return true;
}();

}  // namespace
}  // namespace forcegrid::bench
