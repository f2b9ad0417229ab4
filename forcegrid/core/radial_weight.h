// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace forcegrid {

/// How a grid method's weight falls with the distance d from a sample, within r; h is the geometric
/// mean of the grid's spacings. Names on the command line: paper, idw4, idw6.
enum class WeightKind {
  kPaper,     ///< 1 / (1 + (d/L)^2) - (d/L) / ((r/L) (1 + (r/L)^2))
  kInverse4,  ///< (1 - d/r)^2 / (0.05 + (d/h)^4)
  kInverse6,  ///< (1 - d/r)^2 / (0.05 + (2 d/h)^6)
};

/// How a sample's force spreads over the vertices around it (the paper's "candle light"): a weight
/// w(d) for d < r, by one of the formulas of WeightKind, and none beyond.
///
/// The paper's weight falls from 1 at d = 0 to 0 at d = r. It adds 1 to d^2 without stating the
/// unit of d. L is that unit, and it decides the result: with L in metres the field is a moving
/// average over the whole sphere, with 1 mm (the default here) it follows the nearest samples. The
/// inverse powers fall from 20 and are sharper: a vertex beside a sample takes almost exactly its
/// force.
/// Source: forcegrid paper, section 5, with the unit made explicit; inverse distance weighting,
/// Shepard 1968, in the bounded form of Franke and Little (1 - d/r)^2.
struct RadialWeight {
  double influence_radius_m = 0.0;       ///< r
  double unit_m = 1e-3;                  ///< L, of the paper's weight only
  WeightKind kind = WeightKind::kPaper;  ///< which formula
  double mean_spacing_m = 1.0;           ///< h, of the inverse powers only

  double weight(double distance_m) const noexcept;
};

}  // namespace forcegrid
