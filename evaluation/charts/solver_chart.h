// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "simulator/bench/solver_scaling.h"

namespace forcegrid::evaluation {

/// One JSON object per row; keys include the units.
nlohmann::ordered_json to_json(const std::vector<simulator::SolverScalingRow>& rows,
                               double rate_Hz);

/// Creates `folder` and writes solvers.json, solvers.csv and solvers.svg into it. The picture shows
/// the servo's time per cycle (mean, with a line to the longest), the vertices touched, and the
/// force's error, each over the object's number of vertices. Lines join the blocks.
/// @returns the files, the picture last.
/// @throws FileError or ChartError, with the remedy.
std::vector<std::filesystem::path> write_solver_chart(
    const std::filesystem::path& folder, const std::vector<simulator::SolverScalingRow>& rows,
    double rate_Hz);

}  // namespace forcegrid::evaluation
