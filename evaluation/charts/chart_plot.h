// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/charts/chart.h"

namespace forcegrid::evaluation {

/// Size of a picture of error against cost, and the methods whose labels it shows beside those of
/// the front.
struct ErrorCostLayout {
  double width_px = 1000.0;
  double height_px = 620.0;
  std::vector<std::string> labelled;  ///< empty: all of them
};

/// Draws `points` as an SVG with logarithmic axes: error over cost per servo cycle. A line joins
/// the Pareto front, and a mark shows the paper's method (plain `forcegrid`). Points whose error or
/// cost is not positive are left out. Labels keep clear of the front, of marks and of each other
/// where there is room.
/// @param all in order of rising cost, as points_of() returns them.
/// @returns false, without a picture, if no point remains.
/// @throws ChartError with the remedy if gnuplot can't be run or the file can't be written.
bool write_error_cost_svg(const std::filesystem::path& file, const std::string& title,
                          const std::vector<ChartPoint>& all, const ErrorCostLayout& layout = {});

}  // namespace forcegrid::evaluation
