#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/common/child_process.h"
#include "cli/run/run_command.h"
#include "cli/run/worker_processes.h"
#include "link/key.h"
#include "profiles/device_profile.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// The processes that a run starts beside itself: the simulator, its workers and the emulated
/// device, each only where the options do not name one that already runs. They end with it.
class RunProcesses {
 public:
  /// Starts them, and returns when they listen.
  /// @throws std::runtime_error or link::LinkError naming the one that does not, and why.
  RunProcesses(const RunOptions& options, const simulator::ToolOptions& tool,
               const profiles::DeviceProfile& profile);

  [[nodiscard]] bool has_emulator() const { return emulator_ != nullptr; }
  [[nodiscard]] bool has_simulator() const { return simulator_ != nullptr; }
  [[nodiscard]] const std::string& device_url() const { return device_url_; }
  [[nodiscard]] const std::string& simulator_address() const { return simulator_address_; }
  /// Of the link to the simulator, the workers' among them; once.
  [[nodiscard]] std::vector<link::LinkKey> take_link_keys() { return std::move(link_keys_); }

  /// How the simulator ended, once: nothing while it runs, and after it has been told.
  std::optional<std::string> simulator_end();

  /// Ends a process, and returns its own report; nothing if there is none.
  std::optional<nlohmann::json> finish_emulator();
  std::optional<nlohmann::json> finish_simulator();
  /// How the emulator ended where it gave no report, as part of a sentence.
  std::string emulator_end();

 private:
  std::vector<std::string> key_files_;
  std::vector<link::LinkKey> link_keys_;
  std::unique_ptr<WorkerProcesses> workers_;
  std::unique_ptr<ChildProcess> emulator_;
  std::unique_ptr<ChildProcess> simulator_;
  std::string device_url_;
  std::string simulator_address_;
  bool simulator_end_told_ = false;
};

}  // namespace forcegrid::cli
