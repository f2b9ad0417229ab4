// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "paper/comparison.h"
#include "paper/discrimination.h"
#include "paper/figures.h"
#include "paper/options.h"
#include "paper/resolutions.h"
#include "paper/shapes.h"
#include "paper/timing.h"

namespace forcegrid::paper {

/// Results of all experiments.
struct Results {
  Timing timing;
  Figures figures;
  std::vector<ResolutionRow> resolutions;
  Comparison comparison;
  Discrimination discrimination;
  std::vector<ShapeDifference> shapes;
  double elapsed_s = 0.0;
};

}  // namespace forcegrid::paper
