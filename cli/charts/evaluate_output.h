// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "evaluation/judge/method_costs.h"
#include "forcegrid/methods.h"

namespace forcegrid::cli {

/// Evaluates each method, with a progress line.
/// @param evaluate  returns what to print of the method `index`.
/// @returns what to print: that for one method, an object keyed by method for several.
nlohmann::ordered_json evaluate_each(
    const std::vector<std::string>& methods,
    const std::function<nlohmann::ordered_json(std::size_t index)>& evaluate);

/// Adds the costs of a cycle and the timer's floor.
void add_cycle_costs(nlohmann::ordered_json& json, const evaluation::MethodCosts& costs);

/// Adds a method's own counters, and cycles_known to cycles_not_finite.
/// @param cycles  indexed by EstimateStatus.
void add_counters(nlohmann::ordered_json& json, std::span<const NamedCounter> counters,
                  const std::array<std::size_t, 5>& cycles);

/// [m] Both corners of the box: x0, y0, z0, x1, y1, z1.
nlohmann::ordered_json json_of_workspace(const GridGeometry& grid);

/// Says "Note: ..." in the log.
void note_of_evaluation(const std::string& text);

/// The columns of a file of forces: t_s, then positions, reference forces and each method's forces,
/// each with all components. Commas in a method's text become blanks.
struct ForceColumns {
  std::string_view position;                     ///< stands before a position's component
  std::span<const std::string_view> components;  ///< such as x, y, z
};

/// Writes such a file, gzipped if its name ends in .gz.
/// @param row  appends the numbers of one row, t_s first.
/// @throws evaluation::FileError.
void write_force_columns(
    const std::string& file, const ForceColumns& columns, const std::vector<std::string>& methods,
    std::size_t rows,
    const std::function<void(std::size_t index, std::vector<double>& numbers)>& row);

}  // namespace forcegrid::cli
