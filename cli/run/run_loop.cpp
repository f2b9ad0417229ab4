// SPDX-License-Identifier: Apache-2.0
// Run's loop, until it is over, and why it was.
#include <cmath>
#include <string>

#include "cli/common/stop_request.h"
#include "cli/run/reconnect.h"
#include "cli/run/run.h"
#include "cli/run/run_checks.h"
#include "cli/run/run_device.h"
#include "rt/clock.h"
#include "servo_loop/watched_run.h"

namespace forcegrid::cli {
namespace {

using std::chrono::milliseconds;

// CLOCK_MONOTONIC, as the samples' times of arrival.
double now_s() { return 1e-9 * static_cast<double>(rt::Clock::now().time_since_epoch().count()); }

}  // namespace

// Says what the simulator does, and ends the run if it has none any more.
void Run::watch_simulator() {
  if (const auto how = processes_->simulator_end()) {
    simulator_died_ = true;
    note("the simulator process " + *how + " during the run; the force faded to zero");
    say(summary_.notes.back(), log::Level::kWarn);
  }
  const std::int64_t sample_ns = link_->newest_sample_ns();
  const auto line = watch_->update(
      now_s(), sample_ns == 0 ? std::nullopt : std::optional(1e-9 * static_cast<double>(sample_ns)),
      link_->nobody_listens());
  if (line && !simulator_died_) {
    say(*line,
        watch_->state() == SimulatorWatch::State::kThere ? log::Level::kInfo : log::Level::kWarn);
  }
  if (note_if_barred() && !options_.wait_for_simulator) {
    StopRequest::request();
  }
  // A process of this run does not come back; its force has faded when it counts as lost.
  if (watch_->gave_up() || (simulator_died_ && watch_->state() != SimulatorWatch::State::kThere)) {
    StopRequest::request();
  }
}

// Whether the simulator has said that it does not serve this tool; a note says so once.
bool Run::note_if_barred() {
  using Barred = servo::LinkThread::Barred;
  const Barred barred = link_->barred();
  if (barred == Barred::kNo || barred_) {
    return barred != Barred::kNo;
  }
  barred_ = true;
  const std::string where = "the simulator at " + processes_->simulator_address();
  const std::string tool = std::to_string(options_.tool_number);
  switch (barred) {
    case Barred::kAllPlacesTaken: {
      const std::uint32_t most = link_->most_tools();
      note(where + " serves " + std::to_string(most) + (most == 1 ? " tool" : " tools") +
           " and has no place for tool " + tool +
           "; end another run, or start it with a larger --tools");
      break;
    }
    case Barred::kToolTaken:
      note(where + " has another servo that moves tool " + tool +
           "; give this run another --tool-number");
      break;
    case Barred::kOtherFault:
      note(where +
           " has stopped every tool, because the device of another one has failed; 'forcegrid "
           "simulate --fault-stops one' lets the others go on");
      break;
    case Barred::kKnowsOneTool:
      note(
          where + " knows one tool (version 1 of the link), so tool " + tool +
          " cannot be one of several there; leave --tool-number out, or use a simulator that knows "
          "several, such as 'forcegrid simulate --tools 2'");
      break;
    case Barred::kNo:
      break;
  }
  say(summary_.notes.back(), log::Level::kWarn);
  return true;
}

// Runs the loop until it ends by itself.
servo::ServoOutcome Run::run_loop(double for_s) {
  watch_->begin(now_s());
  return servo::run_watched(*loop_, StopRequest::stop(), for_s, StopRequest::request, [this] {
    look_at_keys(milliseconds(20));
    watch_simulator();
  });
}

// Runs the loop; with --reconnect again after each fault that a disconnected device may have
// caused.
void Run::run_until_over() {
  double left_s = options_.seconds;
  for (;;) {
    const rt::TimePoint begun = rt::Clock::now();
    const std::uint64_t missed_before = summary_.outcome.missed_deadlines;
    summary_.outcome = run_loop(left_s);
    summary_.outcome.missed_deadlines += missed_before;
    const rt::TimePoint ended = rt::Clock::now();
    left_s -= options_.seconds > 0.0 ? rt::seconds(ended - begun) : 0.0;
    if (!options_.reconnect || !servo::may_be_over_after_reconnecting(summary_.outcome.fault) ||
        StopRequest::stop() || (options_.seconds > 0.0 && left_s <= 0.0) || !connect_again(ended)) {
      return;
    }
  }
}

// Waits for the disconnected device. False: it did not come back; a note gives the reason.
bool Run::connect_again(rt::TimePoint ended) {
  const servo::Fault fault = summary_.outcome.fault;
  say(servo::sentence_for(fault) + " (" + summary_.outcome.device_failure +
          ")\nWaiting for the device, at most " +
          std::to_string(std::lround(options_.reconnect_timeout_s)) + " s; Ctrl-C ends it.",
      log::Level::kWarn);
  Reconnect how;
  how.open = [&] {
    return open_for_run(url_again_, profile_, firmware_, options_, realtime_refused_.empty());
  };
  how.cancelled = [&] {
    look_at_keys(milliseconds(0));
    return StopRequest::stop().load();
  };
  how.say = [&](const std::string& text) { say(text); };
  how.profile = &profile_;
  how.before = device_->identity();
  how.last_counts = device_->newest_report().counts;
  how.may_calibrate = !options_.calibrated || is_falcon(profile_);
  how.timeout = rt::from_seconds(options_.reconnect_timeout_s);
  driver::add(summary_.device_statistics, device_->statistics());
  device_.reset();
  Reconnected again = reconnect(how);
  if (!again.device) {
    note("the device was not reconnected: " + again.why_not);
    return false;
  }
  device_ = std::move(again.device);
  loop_->continue_with(*device_);
  summary_.recovered.push_back(
      {fault, summary_.outcome.device_failure, ended.time_since_epoch().count()});
  summary_.recalibrations += again.recalibrated ? 1 : 0;
  say("The device is back" +
      std::string(again.recalibrated ? " and calibrated" : " with its counters unchanged") +
      "; the force ramps in.");
  return true;
}

// Why the loop is over; before the work after it, during which more may come.
void Run::judge_end() {
  const servo::Fault fault = summary_.outcome.fault;
  summary_.signal_name = StopRequest::signal_name();
  if (fault == servo::Fault::kEmergencyStop || StopRequest::emergency().pressed()) {
    summary_.end = RunEnd::kEmergencyStop;
  } else if (fault != servo::Fault::kNone) {
    summary_.end = RunEnd::kFault;
  } else if (shared_ != nullptr && shared_->fault_stops_all && shared_->failed_device != 0) {
    summary_.end = RunEnd::kOtherDevice;
    note("device " + std::to_string(shared_->failed_device) +
         " had a fault, which brought this one to zero force, too (--fault-stops)");
  } else if (barred_ && link_->barred() == servo::LinkThread::Barred::kOtherFault) {
    summary_.end = RunEnd::kOtherDevice;
  } else if (StopRequest::signal() != 0) {
    summary_.end = RunEnd::kSignal;
  } else if (watch_->missing() ||
             (simulator_died_ && watch_->state() != SimulatorWatch::State::kThere)) {
    summary_.end = watch_->state() == SimulatorWatch::State::kNever ? RunEnd::kNoSimulator
                                                                    : RunEnd::kLostSimulator;
  } else if (next_scene_.chosen()) {
    summary_.end = RunEnd::kScene;
  }
}

// A signal that shortened the work after the loop counts, too, and so does a file that failed.
void Run::settle_status() {
  const int signal = StopRequest::signal();
  summary_.signal_name = StopRequest::signal_name();
  summary_.exit_status = status_of(summary_.end, signal);
  if (summary_.exit_status == 0) {
    summary_.exit_status = signal != 0 ? status_after(signal) : file_failed_ ? 1 : 0;
  }
}

}  // namespace forcegrid::cli
