// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cli/common/child_process.h"

namespace forcegrid::cli {

/// The workers of the simulator that `forcegrid run` starts, and the key that all of them share.
class WorkerProcesses {
 public:
  /// @param key_files of --key. Without one, a new key is made in a temporary folder, which is
  ///         removed when all workers have started, or by the destructor.
  /// @throws std::runtime_error or link::LinkError with the system's reason.
  explicit WorkerProcesses(const std::vector<std::string>& key_files);
  /// Ends the workers.
  ~WorkerProcesses();
  WorkerProcesses(const WorkerProcesses&) = delete;
  WorkerProcesses& operator=(const WorkerProcesses&) = delete;

  [[nodiscard]] const std::vector<std::string>& key_files() const { return key_files_; }

  /// Starts `count` workers and waits until each is ready.
  /// @param listening the line that `forcegrid simulate --workers` printed
  /// @throws std::runtime_error if a worker does not start.
  void start(int count, const std::string& listening, const std::string& scene);

 private:
  void remove_own_key() noexcept;

  std::string own_folder_;  ///< empty: the key is the user's
  std::vector<std::string> key_files_;
  std::vector<std::unique_ptr<ChildProcess>> workers_;
};

}  // namespace forcegrid::cli
