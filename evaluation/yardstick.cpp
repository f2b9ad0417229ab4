#include "evaluation/yardstick.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "evaluation/trajectories.h"
#include "rt/clock.h"

namespace forcegrid::evaluation {
namespace {

using Float4 = float __attribute__((vector_size(16)));

constexpr int kVertices = 50;
constexpr std::size_t kReads = 4096;
constexpr std::size_t kBatches = 301;

Float4 mix(Float4 a, Float4 b, float t) { return a + t * (b - a); }

Float4 read(const std::vector<Float4>& grid, const std::array<float, 3>& p) {
  const int i = static_cast<int>(p[0]);
  const int j = static_cast<int>(p[1]);
  const int k = static_cast<int>(p[2]);
  const float x = p[0] - static_cast<float>(i);
  const float y = p[1] - static_cast<float>(j);
  const float z = p[2] - static_cast<float>(k);
  const Float4* near = &grid[static_cast<std::size_t>((i * kVertices + j) * kVertices + k)];
  const Float4* far = near + kVertices * kVertices;
  return mix(mix(mix(near[0], near[1], z), mix(near[kVertices], near[kVertices + 1], z), y),
             mix(mix(far[0], far[1], z), mix(far[kVertices], far[kVertices + 1], z), y), x);
}

}  // namespace

double bare_trilinear_read_ns() {
  std::vector<Float4> grid(static_cast<std::size_t>(kVertices * kVertices * kVertices));
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const float value = std::sin(static_cast<float>(i));
    grid[i] = Float4{value, 2 * value, 3 * value, 1.0F};
  }
  SeededNumbers random(1);
  std::vector<std::array<float, 3>> positions(kReads);
  for (std::array<float, 3>& p : positions) {
    for (float& coordinate : p) {
      coordinate = static_cast<float>(random.uniform(0.0, kVertices - 1.01));
    }
  }
  std::vector<double> batch_ns(kBatches);
  for (double& ns : batch_ns) {
    Float4 sum{};
    const rt::TimePoint begin = rt::Clock::now();
    for (const std::array<float, 3>& p : positions) {
      sum += read(grid, p);
    }
    // The sum is wanted, as far as the compiler knows.
    asm volatile("" : : "m"(sum) : "memory");
    ns = 1e9 * rt::seconds(rt::Clock::now() - begin) / static_cast<double>(kReads);
  }
  const auto median = batch_ns.begin() + kBatches / 2;
  std::nth_element(batch_ns.begin(), median, batch_ns.end());
  return *median;
}

}  // namespace forcegrid::evaluation
