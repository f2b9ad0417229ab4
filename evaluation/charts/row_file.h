// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

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

/// Adds the rows that shards of a chart have written into the folders `from` to those of `folder`,
/// each once.
/// @returns how many were added. @throws ChartError as RowFile, and if one of the folders has no
/// rows, or some of another program: all shards have to be made by the same one.
std::size_t merge_rows(const std::filesystem::path& folder, const std::string& program,
                       const std::vector<std::filesystem::path>& from);

}  // namespace forcegrid::evaluation
