// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "evaluation/charts/chart.h"
#include "evaluation/charts/row_file.h"

namespace forcegrid::evaluation {

/// A figure of a row: its name in CSV and JSON, and the value.
using RowFigure = std::pair<const char*, double>;

/// All figures of a row in the order of the table's columns; NaN if there is nothing to measure.
std::vector<RowFigure> figures_of(const ChartRow& row);

/// The row as a JSON object: key, scene, trajectory, condition, method and the figures, null for
/// NaN.
nlohmann::ordered_json to_json(const ChartRow& row);

/// @throws nlohmann::json::exception if to_json() did not make `json`.
ChartRow row_from_json(const nlohmann::ordered_json& json);

/// Finished rows of a chart, see RowFile.
class RowStore {
 public:
  /// @throws ChartError as RowFile.
  RowStore(const std::filesystem::path& folder, const std::string& program);

  /// The row with this key, or null.
  const ChartRow* find(const std::string& key) const;

  /// Adds a row and writes it to the file.
  /// @throws ChartError if the disk is full.
  void keep(const ChartRow& row);

 private:
  std::map<std::string, ChartRow> rows_;
  RowFile file_;
};

}  // namespace forcegrid::evaluation
