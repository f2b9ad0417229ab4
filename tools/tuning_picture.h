// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/tuning.h"

namespace forcegrid::tools {

/// Writes all rows to `folder`/tuning.csv.
/// @returns the file's name. @throws std::runtime_error if it can't be written.
std::string write_tuning_csv(const std::string& folder, const std::vector<TuningRow>& rows,
                             const TuningChoice& choice);

/// Draws `folder`/tuning.svg and .png: error and missed deadlines over rate, error over the
/// method's cost, and error over the fill budget. The chosen setting and the tolerated error are
/// marked; a tolerance of zero has no place on a logarithmic axis.
/// @returns the files drawn.
/// @throws std::runtime_error if a picture can't be drawn.
std::vector<std::string> draw_tuning(const std::string& folder, const std::vector<TuningRow>& rows,
                                     const TuningChoice& choice, const TuningTolerance& tolerance);

}  // namespace forcegrid::tools
