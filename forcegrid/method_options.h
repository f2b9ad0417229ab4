#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "forcegrid/candle_light.h"
#include "forcegrid/force_grid.h"
#include "forcegrid/grid_geometry.h"

namespace forcegrid {

/// Where a grid's vertices live. Names: dense, blocks, adaptive.
enum class GridStorage {
  kDense,     ///< one array over the whole workspace
  kBlocks,    ///< blocks from a fixed pool, only where samples came
  kAdaptive,  ///< the paper's adaptive form: a dense grid that follows the tool inside a sparse one
};

/// What methods can be told; each method documents which of these it uses and ignores the others.
/// An absent value means the method's own default.
struct MethodOptions {
  GridGeometry grid;  ///< workspace and cells of the grid methods

  double influence_radius_m = 0.0;   ///< r; 0: a sixth of the workspace's x extent
  double unit_m = 1e-3;              ///< L of the paper's weight, see CandleLight
  std::optional<WeightKind> weight;  ///< forcegrid: paper; forcegrid-mls: idw4; -tangent: idw6
  int samples_per_cell = 0;          ///< the paper's s; 0: no threshold
  Interpolation interpolation = Interpolation::kTrilinear;
  GridStorage storage = GridStorage::kDense;
  /// Blocks of block storage; 0: 64 MiB of them, or what four fills need up to 256 MiB.
  int pool_blocks = 0;
  std::optional<double> ridge;   ///< forcegrid-mls: 1e-5
  std::optional<double> nugget;  ///< kriging: noise variance [N^2] a sample, 1e-5

  /// kriging: samples in its dictionary, 2 to 32 (kriging-store: 48), 32. The bank's members have
  /// sizes of their own.
  std::optional<int> samples;
  /// kriging: how far apart samples are kept, in distance (1 mm) or in force (0.1 N).
  std::optional<double> spacing_m, spacing_N;

  /// forcegrid-kriging: h, between vertices, 2 to 20 mm, 4 mm.
  std::optional<double> vertex_spacing_m;

  double influence_radius() const noexcept;  ///< [m] r with its default put in
};

/// A method's name with changes to its options, as people write it: "forcegrid unit=m s=3".
/// Keys: unit (m, cells, mm or a length such as 2mm), r (30mm), s, weight, read, storage, pool
/// (blocks), cells (X,Y,Z or one number for all), ridge, nug, samples, spacing (1mm), spacing_N
/// (0.1), h (4mm).
struct MethodVariant {
  std::string text;  ///< as given, blanks put in order
  std::string name;  ///< of the method
  MethodOptions options;
};

/// @param base what the text does not change.
/// @throws std::invalid_argument naming the word that can't be used and what is known.
MethodVariant parse_method_variant(std::string_view text, const MethodOptions& base);

}  // namespace forcegrid
