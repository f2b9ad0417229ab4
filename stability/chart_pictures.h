#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "stability/chart.h"

namespace forcegrid::stability {

/// Draws the chart's pictures into `folder`, with the theory as lines in them: stiffness over delay
/// for each hand, over servo rate, the plane of stiffness and damping, and the linear plant against
/// its eigenvalues. A picture without data is left out.
/// @returns the files written. @throws evaluation::ChartError when gnuplot fails.
std::vector<std::filesystem::path> draw_pictures(const StabilityChart& chart,
                                                 const std::string& default_method,
                                                 const std::filesystem::path& folder);

}  // namespace forcegrid::stability
