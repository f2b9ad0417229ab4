// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cli/common/stop_watchdog.h"
#include "cli/run/run_command.h"
#include "cli/run/run_judgement.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_processes.h"
#include "cli/run/run_summary.h"
#include "cli/run/run_view.h"
#include "cli/run/shared_reference_forces.h"
#include "cli/run/simulator_watch.h"
#include "cli/run/terminal_keys.h"
#include "cli/run/view_feed.h"
#include "driver/device.h"
#include "driver/open_device.h"
#include "forcegrid/core/method_options.h"
#include "log/log.h"
#include "profiles/device_profile.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/servo_loop.h"
#include "servo_loop/telemetry.h"
#include "simulator/mesh/tool_options.h"
#include "tools/dashboard.h"
#include "tools/recorder.h"

namespace forcegrid::cli {

/// What the runs of several devices in one program share.
struct SharedRun {
  std::string simulator;         ///< address of the one that the first run has started; empty: none
  TerminalKeys* keys = nullptr;  ///< while one thread takes the runs through their steps
  bool fault_stops_all = true;
  PairExchanges pairs;
  std::atomic<int> failed_device{0};  ///< number of the first one that a fault has ended; 0: none
  /// Of all tools together, once every loop is over.
  std::optional<SharedReferenceForces> reference;
};

// One run, from its options to its summary. Members that threads write to come before those
// threads, so that the threads end before the members are destroyed.
class Run {
 public:
  /// Checks everything that can be checked before a process starts or a device is opened.
  /// @param view  that goes on from run to run; null: the first one with a view starts it.
  /// @param shared  of several runs at once; null: this is the only one. It outlives this.
  Run(const RunOptions& options, std::unique_ptr<ViewProcess>& view, SharedRun* shared = nullptr);

  /// @returns the program's exit status.
  int execute();

  /// Of several devices: their tools touch each other with this stiffness [N/m]; 0: they do not.
  /// Before begin(). `exchange` outlives this.
  void touch_others(servo::ToolExchange& exchange, double stiffness_N_per_m);

  // Its steps. Those of several runs are taken in turn by one thread, render() by one each.
  /// Starts processes, opens and calibrates the device. False: stopped before the arm was
  /// calibrated; then finish_uncalibrated() follows.
  bool prepare();
  int finish_uncalibrated();
  /// Starts the threads beside the loop.
  void begin();
  /// Runs the loop until it is over. Every way out has written zero current.
  void render();
  /// Tells the live view how the run ended, if there is one. Several runs call it before the first
  /// finish(), which may take long.
  void end_view();
  /// Ends the rest and writes the files. @returns the exit status of this run alone.
  int finish();

  [[nodiscard]] nlohmann::json json() const;
  [[nodiscard]] const RunSummary& summary() const { return summary_; }
  [[nodiscard]] const profiles::DeviceProfile& profile() const { return profile_; }
  /// What the reference forces of all tools need of this one. Its threads have ended.
  [[nodiscard]] ToolRun tool_run() const;
  /// Where the simulator of this run listens; after prepare().
  [[nodiscard]] const std::string& simulator_address() const {
    return processes_->simulator_address();
  }
  /// The scene that another run is to begin with; nothing: there is to be none.
  std::optional<std::string> next_scene();

 private:
  void say(const std::string& text, log::Level level = log::Level::kInfo,
           const char* component = "run") const;
  void report(const std::string& text) const;
  void report_fault() const;
  void note(const std::string& text) { summary_.notes.push_back(text); }
  void fail(const std::string& text);
  void look_at_keys(std::chrono::milliseconds timeout);

  void connect();
  bool calibrate_arm();
  void prepare_telemetry();
  void start_dashboard();
  void start_view();
  void run_until_over();
  servo::ServoOutcome run_loop(double for_s);
  bool connect_again(rt::TimePoint ended);
  void watch_simulator();
  bool note_if_barred();
  void judge_end();
  void settle_status();
  void stop_threads();
  void finish_processes();
  [[nodiscard]] std::string why_no_reference() const;
  void judge_forces(ContactCycles& cycles);
  void write_files(const ContactCycles& cycles);

  RunOptions options_;
  std::unique_ptr<ViewProcess>& kept_view_;
  SharedRun* shared_;
  std::string prefix_;  // of lines for people: "device 2: "
  NextScene next_scene_;
  std::FILE* out_;
  std::unique_ptr<tools::Dashboard> dashboard_;
  std::optional<log::ConsoleTaker> to_dashboard_;  // while it covers the terminal
  simulator::ToolOptions tool_;
  profiles::DeviceProfile profile_;
  driver::falcon::Firmware firmware_;
  servo::ServoOptions servo_options_;
  MethodOptions method_options_;
  std::optional<RunMethods> methods_;
  RunSummary summary_;
  std::string realtime_refused_;
  std::unique_ptr<tools::Recorder> recorder_;
  std::optional<RunProcesses> processes_;
  servo::ServoPorts ports_;
  std::unique_ptr<ViewFeed> view_;
  std::optional<servo::LinkThread> link_;
  std::optional<SimulatorWatch> watch_;
  bool simulator_died_ = false;
  bool barred_ = false;
  std::optional<OwnEnd> own_end_;  // from when motors may get current until everything is written
  std::unique_ptr<driver::Device> device_;
  std::string url_again_;  // where to find the device again
  std::optional<TerminalKeys> keys_;
  std::optional<servo::Telemetry> telemetry_;
  std::optional<servo::ServoLoop> loop_;
  bool file_failed_ = false;
};

}  // namespace forcegrid::cli
