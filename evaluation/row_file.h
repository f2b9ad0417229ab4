// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace forcegrid::evaluation {

/// Finished rows of a chart in `folder`/rows.jsonl, one JSON object per line, so that an
/// interrupted chart continues where it stopped.
/// Threads: one. Processes: one per folder, enforced by a lock on the file.
class RowFile {
 public:
  /// Reads the rows of an earlier call and passes each to `take`. Removes rows of another program,
  /// incomplete lines, and lines for which `take` throws a JSON exception.
  /// @throws ChartError if the folder can't be created or used, or if another chart is using it.
  RowFile(const std::filesystem::path& folder, const std::string& program,
          const std::function<void(const nlohmann::ordered_json&)>& take);

  /// Adds a row and writes it to the file.
  /// @throws ChartError if the disk is full.
  void keep(nlohmann::ordered_json row);

 private:
  struct Close {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };
  std::filesystem::path file_name_;
  std::string program_;
  std::unique_ptr<std::FILE, Close> lock_;
  std::unique_ptr<std::FILE, Close> file_;
};

}  // namespace forcegrid::evaluation
