// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "stability/chart.h"

namespace forcegrid::stability {

/// Returns the goals that the chart covers, with the measured values.
std::vector<StabilityNumber> numbers_of(const StabilityChart& chart,
                                        const std::string& default_method);

}  // namespace forcegrid::stability
