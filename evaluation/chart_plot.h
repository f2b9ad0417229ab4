#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/chart.h"

namespace forcegrid::evaluation {

/// Draws `all` points as an SVG with both axes logarithmic: error over cost per servo cycle, the
/// Pareto front joined by a line, the paper's method (`forcegrid` as it is) marked. Points whose
/// error or cost is not above zero are left out.
/// @returns false, having drawn nothing, when no point is left.
/// @throws ChartError when gnuplot can't be run or the file not be written, with the remedy.
bool write_error_cost_svg(const std::filesystem::path& file, const std::string& title,
                          const std::vector<ChartPoint>& all);

}  // namespace forcegrid::evaluation
