// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace forcegrid::evaluation {

/// The minimal trilinear read, the baseline for the costs of queries: eight aligned loads of four
/// floats and their weighted sum, in a grid of 50^3 vertices (2 MB). It has no bounds check and no
/// status, and takes positions in cells.
/// Real-time: read() is safe. Threads: any.
class BareTrilinearGrid {
 public:
  static constexpr int kVertices = 50;  ///< along each axis
  using Float4 = float __attribute__((vector_size(16)));

  BareTrilinearGrid();

  /// @param cells position in cells, each coordinate in [0, kVertices - 1).
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

/// [ns] Time of a read at a random position on this machine: the median over batches of 4,096
/// reads. Takes about 20 ms.
/// Real-time: no. Threads: any.
double bare_trilinear_read_ns();

}  // namespace forcegrid::evaluation
