// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/core/radial_weight.h"

#include <cmath>

namespace forcegrid {

double RadialWeight::weight(double distance_m) const noexcept {
  if (!(distance_m < influence_radius_m)) {
    return 0.0;
  }
  if (kind == WeightKind::kPaper) {
    const double d = distance_m / unit_m;
    const double r = influence_radius_m / unit_m;
    return 1.0 / (1.0 + d * d) - d / (r * (1.0 + r * r));
  }
  const double fade = 1.0 - distance_m / influence_radius_m;
  const double d = distance_m / mean_spacing_m;
  const double falling = kind == WeightKind::kInverse4 ? std::pow(d, 4) : std::pow(2.0 * d, 6);
  return fade * fade / (0.05 + falling);
}

}  // namespace forcegrid
