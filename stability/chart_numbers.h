#pragma once

#include <string>
#include <vector>

#include "stability/chart.h"

namespace forcegrid::stability {

/// The goals that a chart can tell about.
std::vector<StabilityNumber> numbers_of(const StabilityChart& chart,
                                        const std::string& default_method);

}  // namespace forcegrid::stability
