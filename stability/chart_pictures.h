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

/// Draws the largest stable stiffness over the delay for a light hand at 500 Hz, as for a page's
/// first screen.
/// @returns false, without a picture, if the chart has no such cells.
/// @throws evaluation::ChartError if gnuplot fails.
bool draw_stiffness(const StabilityChart& chart, const std::string& default_method,
                    const std::filesystem::path& file);

}  // namespace forcegrid::stability
