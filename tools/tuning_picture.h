// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/tuning.h"

namespace forcegrid::tools {

/// Writes `folder`/tuning.csv and draws tuning.svg and .png from it: error and missed deadlines
/// over rate, error over the method's cost, and error over the fill budget. The chosen setting and
/// the tolerated error are marked.
/// @returns the files written.
/// @throws std::runtime_error if a file can't be written or drawn.
std::vector<std::string> draw_tuning(const std::string& folder, const std::vector<TuningRow>& rows,
                                     const TuningChoice& choice, const TuningTolerance& tolerance);

}  // namespace forcegrid::tools
