#pragma once

#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "evaluation/chart.h"

namespace forcegrid::evaluation {

/// A figure of a row: its name in CSV and JSON, and the value.
using RowFigure = std::pair<const char*, double>;

/// All figures of a row in the order of the table's columns; NaN where there is nothing to measure.
std::vector<RowFigure> figures_of(const ChartRow& row);

/// The row as an object: key, scene, trajectory, condition, method and the figures, null for NaN.
nlohmann::ordered_json to_json(const ChartRow& row);

/// @throws nlohmann::json::exception for anything that to_json() did not make.
ChartRow row_from_json(const nlohmann::ordered_json& json);

/// Finished rows of a chart, one a line in `folder`/rows.jsonl.
/// Threads: one. Processes: one a folder, which a lock on the file enforces.
class RowStore {
 public:
  /// Reads what an earlier call of the same program left; rows of another program are removed, as
  /// is a line that was cut off in the middle.
  /// @throws ChartError when the folder can't be made or used, or another chart is using it.
  RowStore(const std::filesystem::path& folder, const std::string& program);

  /// The row with this key, or null.
  const ChartRow* find(const std::string& key) const;

  /// Adds a row; it is in the file when this returns.
  /// @throws ChartError when the disk is full.
  void keep(const ChartRow& row);

 private:
  struct Close {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };
  std::filesystem::path file_name_;
  std::string program_;
  std::map<std::string, ChartRow> rows_;
  std::unique_ptr<std::FILE, Close> lock_;
  std::unique_ptr<std::FILE, Close> file_;
};

}  // namespace forcegrid::evaluation
