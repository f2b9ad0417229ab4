// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/common/child_process.h"
#include "cli/run/run_command.h"
#include "cli/run/surface_tap.h"
#include "cli/run/view_process.h"
#include "cli/run/worker_processes.h"
#include "link/key.h"
#include "profiles/device_profile.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// The child processes of a run: the simulator, its workers, the emulated device and the live view.
/// Each is started only if the options do not name one that is already running. All but the
/// view end with this object.
class RunProcesses {
 public:
  /// Starts the processes and returns when all of them listen.
  /// @param view  with --view: used if it is there, else started and left there.
  /// @throws std::runtime_error or link::LinkError naming the process that does not start, and the
  ///         reason.
  RunProcesses(const RunOptions& options, const simulator::ToolOptions& tool,
               const profiles::DeviceProfile& profile, std::unique_ptr<ViewProcess>& view);

  ~RunProcesses();
  RunProcesses(const RunProcesses&) = delete;
  RunProcesses& operator=(const RunProcesses&) = delete;

  [[nodiscard]] bool has_emulator() const { return emulator_ != nullptr; }
  [[nodiscard]] bool has_simulator() const { return simulator_ != nullptr; }
  [[nodiscard]] const std::string& device_url() const { return device_url_; }
  [[nodiscard]] const std::string& simulator_address() const { return simulator_address_; }
  /// The live view; null without --view.
  [[nodiscard]] const ViewProcess* view() const { return view_; }
  /// Where the simulator's surface goes on its way to the recording; null without --record-surface.
  [[nodiscard]] SurfaceTap* surface_tap() const { return surface_tap_.get(); }
  /// Moves out the keys of the link to the simulator, including the workers'. Call once.
  [[nodiscard]] std::vector<link::LinkKey> take_link_keys() { return std::move(link_keys_); }

  /// Reports once how the simulator ended; nothing while it runs, and after the first report.
  std::optional<std::string> simulator_end();

  /// Asks the simulator to end, even in the middle of a solution; its report can still be read.
  void hurry_simulator() noexcept;
  /// Ends a process and returns its report; nothing if there is none.
  std::optional<nlohmann::json> finish_emulator();
  std::optional<nlohmann::json> finish_simulator();
  /// How the emulator ended if it wrote no report, as part of a sentence.
  std::string emulator_end();

 private:
  void start(const RunOptions& options, const simulator::ToolOptions& tool,
             const profiles::DeviceProfile& profile, std::unique_ptr<ViewProcess>& view);
  void end_all() noexcept;

  std::vector<std::string> key_files_;
  std::vector<link::LinkKey> link_keys_;
  const ViewProcess* view_ = nullptr;  // ends last: it shows how the others ended
  std::unique_ptr<SurfaceTap> surface_tap_;
  std::unique_ptr<WorkerProcesses> workers_;
  std::unique_ptr<ChildProcess> emulator_;
  std::unique_ptr<ChildProcess> simulator_;
  std::string device_url_;
  std::string simulator_address_;
  bool simulator_end_reported_ = false;
};

}  // namespace forcegrid::cli
