// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "forcegrid/candle_light.h"
#include "forcegrid/force_method.h"
#include "forcegrid/grid_geometry.h"
#include "forcegrid/kriging_field.h"
#include "forcegrid/method_options.h"
#include "forcegrid/methods.h"

int main() {
  forcegrid::MethodOptions base;
  base.grid.max_W.setConstant(0.1);
  base.grid.cells.setConstant(10);
  const forcegrid::MethodVariant variant =
      forcegrid::parse_method_variant("forcegrid r=20mm", base);
  const auto method = forcegrid::make_force_method(variant.name, variant.options);
  std::printf("%s\n", method->name());
  return variant.options.influence_radius() == 0.02 ? 0 : 1;
}
