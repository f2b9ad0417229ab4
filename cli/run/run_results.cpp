// SPDX-License-Identifier: Apache-2.0
// What Run does when its loop is over: threads, processes, files.
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "cli/common/figures.h"
#include "cli/common/stop_request.h"
#include "cli/run/recording.h"
#include "cli/run/reference_forces.h"
#include "cli/run/run.h"
#include "cli/run/run_summary_json.h"
#include "cli/run/run_summary_text.h"
#include "evaluation/files/gnuplot.h"
#include "rt/checkpoint.h"
#include "rt/thread.h"
#include "tools/hdf5_file.h"

namespace forcegrid::cli {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kWatchdogProof{700};

}  // namespace

void Run::stop_threads() {
  if (summary_.outcome.fault == servo::Fault::kEmergencyStop) {
    StopRequest::request_emergency(summary_.outcome.emergency);  // skips the remaining work
  }
  if (StopRequest::stop() && shared_ == nullptr) {
    processes_->hurry_simulator();
  }
  keys_.reset();
  link_->stop(summary_.outcome.fault != servo::Fault::kNone);
  telemetry_->stop();
  to_dashboard_.reset();
  dashboard_.reset();
  if (shared_ == nullptr) {  // else the other loops still need it
    rt::unlock_memory();
  }
}

void Run::finish_processes() {
  const bool emulated = processes_->has_emulator();
  if (emulated && !summary_.outcome.zero_current_delivered) {
    // Leaves time for the device's watchdog, which needs half a second.
    std::this_thread::sleep_for(kWatchdogProof);
  }
  summary_.emulator = processes_->finish_emulator();
  summary_.simulator = processes_->finish_simulator();
  if (summary_.emulator) {
    report(motors_text(*summary_.emulator));
  } else if (emulated) {
    note("the emulator wrote no report; it " + processes_->emulator_end());
    say("Note: " + summary_.notes.back(), log::Level::kWarn);
  }
  if (summary_.simulator) {
    report(workers_text(*summary_.simulator));
  }
}

// Why no reference forces are computed; empty: they are.
std::string Run::why_no_reference() const {
  if (!options_.simulator.empty()) {
    return "only the scenes of 'forcegrid simulate' have reference forces";
  }
  if (tool_.slides()) {
    return "none: the force on a sliding tool depends on its path";
  }
  if (tool_.turns) {
    return "none: the force depends on the tool's orientation";
  }
  for (const auto& change : summary_.setting_changes) {
    if (change.at("name") == "wall_mm" || change.at("name") == "cut") {
      return "none: a wall or a cut was chosen in the live view";
    }
  }
  return options_.no_reference ? "skipped by --no-reference" : "";
}

ToolRun Run::tool_run() const {
  return {link_->first_contact(), cycles_since(link_->first_contact(), telemetry_->records()),
          &link_->samples()};
}

void Run::judge_forces(ContactCycles& cycles) {
  const auto solve = [this](const ContactCycles& path,
                            const simulator::ReferenceOptions& reference_options) {
    if (shared_ != nullptr) {
      return shared_->reference->of(static_cast<std::size_t>(options_.device_number - 1),
                                    reference_options);
    }
    std::vector<double> times_s;
    for (std::size_t i = 0; i < path.records.size(); ++i) {
      times_s.push_back(path.time_s(i));
    }
    return solve_reference_forces(options_.solver, path.positions_W, times_s, reference_options);
  };
  judge(options_.scene, methods_->names(), why_no_reference(), link_->first_contact(), solve,
        cycles, summary_);
}

void Run::write_files(const ContactCycles& cycles) {
  const std::vector<std::string>& names = methods_->names();
  try {
    if (records_trace(options_)) {
      if (cycles.reference_W.empty()) {
        throw std::runtime_error("no trace was recorded in " + options_.record +
                                 ", because there are no reference forces: " + summary_.reference);
      }
      evaluation::write_trace(options_.record, trace_of(link_->samples(), cycles.records,
                                                        cycles.reference_W, cycles.contact_ns));
      summary_.files.push_back(options_.record);
    }
  } catch (const std::runtime_error& error) {
    fail(error.what());
  }
  try {
    const std::vector<FigureRow> rows = figure_rows(cycles, names.size());
    summary_.files.push_back(write_figure_data(options_.out, names, rows));
    if (summary_.end == RunEnd::kScene) {
      return;  // the next run waits
    }
    for (std::string& file : draw_figures(options_.out, names, rows)) {
      summary_.files.push_back(std::move(file));
    }
  } catch (const rt::Interrupted&) {
    note("the pictures were skipped by " + StopRequest::signal_name());
  } catch (const evaluation::NoGnuplot& error) {
    note(std::string("no pictures: ") + error.what());
    say("Note: " + summary_.notes.back());
  } catch (const std::runtime_error& error) {
    fail(error.what());
  }
  if (!recorder_) {
    return;
  }
  const tools::RecorderEnd& recorded = recorder_->finish();
  if (!recorded.closed) {
    return;  // the recorder has said what went wrong and what is left
  }
  summary_.files.push_back(options_.record);
  try {
    complete_recording(*recorder_, options_.record, cycles.records, cycles.reference_W,
                       to_json(summary_, telemetry_->statistics()).dump());
  } catch (const tools::Hdf5Error& error) {
    summary_.files.pop_back();
    fail(error.what());
  }
}

}  // namespace forcegrid::cli
