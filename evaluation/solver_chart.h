#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "simulator/bench/solver_scaling.h"

namespace forcegrid::evaluation {

/// One object a row; keys carry the units.
nlohmann::ordered_json to_json(const std::vector<simulator::SolverScalingRow>& rows,
                               double rate_Hz);

/// Writes solvers.json, solvers.csv and solvers.svg into `folder`, which it makes. The picture: the
/// servo's time a cycle (mean, with a line up to the longest one), the vertices touched, and the
/// force's error, each against the object's vertices; blocks joined by lines.
/// @returns the files, the picture last.
/// @throws FileError or ChartError, with the remedy.
std::vector<std::filesystem::path> write_solver_chart(
    const std::filesystem::path& folder, const std::vector<simulator::SolverScalingRow>& rows,
    double rate_Hz);

}  // namespace forcegrid::evaluation
