#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace forcegrid::evaluation {

/// The least that a trilinear read can do, to which the costs of queries are compared: eight
/// aligned loads of four floats and their weighted sum, in a grid of 50^3 vertices (2 MB), without
/// bounds or status, at positions that are already in cells.
/// Real-time: read() is. Threads: any.
class BareTrilinearGrid {
 public:
  static constexpr int kVertices = 50;  ///< along each axis
  using Float4 = float __attribute__((vector_size(16)));

  BareTrilinearGrid();

  /// @param cells position, each coordinate in 0 to below kVertices - 1.
  Float4 read(const std::array<float, 3>& cells) const noexcept {
    const int i = static_cast<int>(cells[0]);
    const int j = static_cast<int>(cells[1]);
    const int k = static_cast<int>(cells[2]);
    const float x = cells[0] - static_cast<float>(i);
    const float y = cells[1] - static_cast<float>(j);
    const float z = cells[2] - static_cast<float>(k);
    const Float4* near = &values_[static_cast<std::size_t>((i * kVertices + j) * kVertices + k)];
    const Float4* far = near + kVertices * kVertices;
    return mix(mix(mix(near[0], near[1], z), mix(near[kVertices], near[kVertices + 1], z), y),
               mix(mix(far[0], far[1], z), mix(far[kVertices], far[kVertices + 1], z), y), x);
  }

 private:
  static Float4 mix(Float4 a, Float4 b, float t) noexcept { return a + t * (b - a); }

  std::vector<Float4> values_;
};

/// [ns] What a read at a random place of it takes on this machine now: the median over batches of
/// 4,096. Takes some 20 ms.
/// Real-time: no. Threads: any.
double bare_trilinear_read_ns();

}  // namespace forcegrid::evaluation
