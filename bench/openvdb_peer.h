// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>

namespace forcegrid::bench {

/// OpenVDB's trilinear sampler on a vector grid of the same size: the peer for a grid query.
/// This header keeps OpenVDB's headers out of all but one file.
class OpenVdbGrid {
 public:
  /// A dense cube of `vertices`^3 values, each (i, j, k) holding sin of its index.
  explicit OpenVdbGrid(int vertices);
  ~OpenVdbGrid();

  /// Samples `count` positions in index space with BoxSampler through one accessor, as the library
  /// recommends for repeated access. Returns the sum of the results, so that none is optimised
  /// away.
  std::array<float, 3> sample_all(const std::array<double, 3>* index_positions, int count) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace forcegrid::bench
