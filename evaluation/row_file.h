#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace forcegrid::evaluation {

/// Finished rows of a chart, one JSON object a line in `folder`/rows.jsonl, so that an interrupted
/// chart goes on where it stopped.
/// Threads: one. Processes: one a folder, which a lock on the file enforces.
class RowFile {
 public:
  /// Reads what an earlier call of the same program left and hands each row to `take`; rows of
  /// another program are removed, as is a line that was cut off in the middle or of which `take`
  /// throws a JSON exception.
  /// @throws ChartError when the folder can't be made or used, or another chart is using it.
  RowFile(const std::filesystem::path& folder, const std::string& program,
          const std::function<void(const nlohmann::ordered_json&)>& take);

  /// Adds a row; it is in the file when this returns.
  /// @throws ChartError when the disk is full.
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
