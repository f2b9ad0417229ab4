// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/chart.h"

namespace forcegrid::evaluation {

/// Draws `points` as an SVG with logarithmic axes: error over cost per servo cycle. A line joins
/// the Pareto front, and a mark shows the paper's method (plain `forcegrid`). Points whose error or
/// cost is not positive are left out.
/// @returns false, without a picture, if no point remains.
/// @throws ChartError with the remedy if gnuplot can't be run or the file can't be written.
bool write_error_cost_svg(const std::filesystem::path& file, const std::string& title,
                          const std::vector<ChartPoint>& all);

}  // namespace forcegrid::evaluation
