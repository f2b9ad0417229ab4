// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "stability/chart.h"

namespace forcegrid::stability {

/// Draws the chart's pictures into `folder`, with theory as dashed lines: stiffness over delay for
/// each hand, stiffness over servo rate, stiffness over damping, and the linear plant against its
/// eigenvalues. A picture without data is left out.
/// @returns the files written. @throws evaluation::ChartError if gnuplot fails.
std::vector<std::filesystem::path> draw_pictures(const StabilityChart& chart,
                                                 const std::string& default_method,
                                                 const std::filesystem::path& folder);

}  // namespace forcegrid::stability
