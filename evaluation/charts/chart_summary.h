// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "evaluation/charts/chart.h"

namespace forcegrid::evaluation {

/// The points of a scene's picture, in order of rising cost.
std::vector<ChartPoint> points_of(const Chart& chart, const std::string& scene);

/// The goals that the chart covers, for `default_method` on the hardest scene of the chart.
std::vector<ChartNumber> numbers_of(const Chart& chart, const std::string& default_method);

}  // namespace forcegrid::evaluation
