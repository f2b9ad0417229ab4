#pragma once

#include <string>
#include <vector>

#include "tools/tuning.h"

namespace forcegrid::tools {

/// Draws `folder`/tuning.svg and .png from tuning.csv, which it writes, too: error and misses
/// against rate, error against what the method costs, error against the fill budget; the chosen one
/// and the tolerated error are marked.
/// @throws std::runtime_error when that can't be done.
std::vector<std::string> draw_tuning(const std::string& folder, const std::vector<TuningRow>& rows,
                                     const TuningChoice& choice, const TuningTolerance& tolerance);

}  // namespace forcegrid::tools
