// SPDX-License-Identifier: Apache-2.0
#include "paper/timing.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "evaluation/judge/baseline_cost.h"
#include "evaluation/motions/trajectories.h"
#include "paper/options.h"
#include "rt/clock.h"

namespace forcegrid::paper {
namespace {

using Eigen::Vector3d;

constexpr double kWorkspace_m[3] = {0.16, 0.12, 0.12};
constexpr int kCells[3] = {49, 49, 49};
constexpr double kRadius_m = 0.16 / 6.0;
constexpr int kAllWork = std::numeric_limits<int>::max();
constexpr std::size_t kQueries = 4096;
constexpr std::size_t kBatches = 101;
constexpr std::size_t kFills = 1001;

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Sample sample_at(const Vector3d& position_W, double time_s) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = position_W;
  sample.force_W = Vector3d(1.0, 2.0, std::sin(100.0 * position_W.x()));
  sample.contact_epoch = 1;
  return sample;
}

}  // namespace

std::size_t count_vertices_within(const double (&point_m)[3], double radius_m,
                                  const int (&cells)[3], const double (&extent_m)[3]) {
  std::size_t count = 0;
  for (int i = 0; i <= cells[0]; ++i) {
    for (int j = 0; j <= cells[1]; ++j) {
      for (int k = 0; k <= cells[2]; ++k) {
        const double x_m = extent_m[0] * i / cells[0] - point_m[0];
        const double y_m = extent_m[1] * j / cells[1] - point_m[1];
        const double z_m = extent_m[2] * k / cells[2] - point_m[2];
        count += x_m * x_m + y_m * y_m + z_m * z_m < radius_m * radius_m ? 1 : 0;
      }
    }
  }
  return count;
}

Timing measure_timing() {
  Timing timing;
  timing.influence_radius_m = kRadius_m;
  const double middle_m[3] = {0.5 * kWorkspace_m[0], 0.5 * kWorkspace_m[1], 0.5 * kWorkspace_m[2]};
  timing.vertices_within_r = count_vertices_within(middle_m, kRadius_m, kCells, kWorkspace_m);
  const auto method = make_method("forcegrid");
  timing.memory_bytes = method->memory_bytes();
  const Vector3d extent_m(kWorkspace_m[0], kWorkspace_m[1], kWorkspace_m[2]);
  const Vector3d centre_W = 0.5 * extent_m;
  method->contact_made(1, centre_W);

  evaluation::SeededNumbers numbers(1);
  std::vector<Vector3d> positions_W(kQueries);
  double time_s = 0.0;
  for (Vector3d& position_W : positions_W) {
    for (int axis = 0; axis < 3; ++axis) {
      position_W[axis] = numbers.uniform(0.0, extent_m[axis]);
    }
    method->take_sample(sample_at(position_W, time_s += 1.0 / kSimulatorRate_Hz));
    method->work(kAllWork);
  }
  std::vector<double> query_ns;
  for (std::size_t batch = 0; batch < kBatches; ++batch) {
    Vector3d sum_N = Vector3d::Zero();
    const rt::TimePoint begin = rt::Clock::now();
    for (const Vector3d& position_W : positions_W) {
      sum_N += method->force(time_s, position_W).force_W;
    }
    // Keeps the compiler from removing the sum.
    asm volatile("" : : "m"(sum_N) : "memory");
    query_ns.push_back(1e9 * rt::seconds(rt::Clock::now() - begin) / kQueries);
  }
  timing.query_ns = median(query_ns);

  std::vector<double> fill_us;
  for (std::size_t fill = 0; fill < kFills; ++fill) {
    const Sample sample = sample_at(centre_W, time_s += 1.0 / kSimulatorRate_Hz);
    const rt::TimePoint begin = rt::Clock::now();
    method->take_sample(sample);
    method->work(kAllWork);
    fill_us.push_back(1e6 * rt::seconds(rt::Clock::now() - begin));
  }
  timing.fill_us = median(fill_us);
  timing.vertex_ns = 1e3 * timing.fill_us / static_cast<double>(timing.vertices_within_r);
  timing.vertices_per_cycle = (1e9 / kServoRate_Hz - timing.query_ns) / timing.vertex_ns;
  timing.vertices_per_answer = timing.vertices_per_cycle * kServoRate_Hz / kSimulatorRate_Hz;
  timing.bare_read_ns = evaluation::bare_trilinear_read_ns();
  return timing;
}

}  // namespace forcegrid::paper
