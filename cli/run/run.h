// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "cli/common/stop_watchdog.h"
#include "cli/run/run_command.h"
#include "cli/run/run_judgement.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_processes.h"
#include "cli/run/run_summary.h"
#include "cli/run/run_view.h"
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

// One run, from its options to its summary. Members that threads write to come before those
// threads, so that the threads end before the members are destroyed.
class Run {
 public:
  /// Checks everything that can be checked before a process starts or a device is opened.
  /// @param view  that goes on from run to run; null: the first one with a view starts it.
  Run(const RunOptions& options, std::unique_ptr<ViewProcess>& view);

  /// @returns the program's exit status.
  int execute();
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
  int end_uncalibrated();
  void prepare_telemetry();
  void start_dashboard();
  void start_view();
  void end_view();
  void run_until_over();
  servo::ServoOutcome run_loop(double for_s);
  bool connect_again(rt::TimePoint ended);
  void watch_simulator();
  void judge_end();
  void settle_status();
  void stop_threads();
  void finish_processes();
  [[nodiscard]] std::string why_no_reference() const;
  void write_files(const ContactCycles& cycles);

  RunOptions options_;
  std::unique_ptr<ViewProcess>& kept_view_;
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
  std::optional<OwnEnd> own_end_;  // from when motors may get current until everything is written
  std::unique_ptr<driver::Device> device_;
  std::string url_again_;  // where to find the device again
  std::optional<TerminalKeys> keys_;
  std::optional<servo::Telemetry> telemetry_;
  std::optional<servo::ServoLoop> loop_;
  bool file_failed_ = false;
};

}  // namespace forcegrid::cli
