// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge/baseline_cost.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "rt/clock.h"

namespace forcegrid::evaluation {
namespace {

constexpr std::size_t kReads = 4096;
constexpr std::size_t kBatches = 301;

}  // namespace

BareTrilinearGrid::BareTrilinearGrid()
    : values_(static_cast<std::size_t>(kVertices * kVertices * kVertices)) {
  for (std::size_t i = 0; i < values_.size(); ++i) {
    const float value = std::sin(static_cast<float>(i));
    values_[i] = Float4{value, 2 * value, 3 * value, 1.0F};
  }
}

double bare_trilinear_read_ns() {
  const BareTrilinearGrid grid;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> coordinate_of_cells(0.0F,
                                                            BareTrilinearGrid::kVertices - 1.01F);
  std::vector<std::array<float, 3>> positions(kReads);
  for (std::array<float, 3>& p : positions) {
    for (float& coordinate : p) {
      coordinate = coordinate_of_cells(random);
    }
  }
  std::vector<double> batch_ns(kBatches);
  for (double& ns : batch_ns) {
    BareTrilinearGrid::Float4 sum{};
    const rt::TimePoint begin = rt::Clock::now();
    for (const std::array<float, 3>& p : positions) {
      sum += grid.read(p);
    }
    // Keeps the compiler from removing the sum.
    asm volatile("" : : "m"(sum) : "memory");
    ns = 1e9 * rt::seconds(rt::Clock::now() - begin) / static_cast<double>(kReads);
  }
  const auto median = batch_ns.begin() + kBatches / 2;
  std::nth_element(batch_ns.begin(), median, batch_ns.end());
  return *median;
}

}  // namespace forcegrid::evaluation
