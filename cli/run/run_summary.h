// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/run/run_end.h"
#include "driver/device.h"
#include "link/clock_estimate.h"
#include "link/messages.h"
#include "link/statistics.h"
#include "rt/percentiles.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::cli {

/// Error of one method against the reference force F_o, in % of the RMS of |F_o| over the contact.
struct MethodError {
  double rms_percent = 0.0;           ///< whole contact
  double rms_percent_first_1s = 0.0;  ///< RMS over the first second of contact
  double rms_percent_after_1s = 0.0;  ///< RMS over the rest
  double max_percent_after_1s = 0.0;
};

/// A fault that did not end the run, because the device came back.
struct RecoveredFault {
  servo::Fault fault = servo::Fault::kNone;
  std::string device_failure;
  std::int64_t time_ns = 0;  ///< CLOCK_MONOTONIC of the end of the loop
};

/// Of a run whose tool has a number: it, the device's unit, its place and the other tools.
struct SeveralTools {
  int tool_number = 0;
  std::string manufacturer;
  std::string product;
  std::string serial;
  std::string url;  ///< finds the unit again
  std::array<double, 3> offset_W_mm{};
  double tool_stiffness_N_per_m = 0.0;  ///< between this program's tools; 0: they do not touch
  std::uint64_t others_told = 0;        ///< messages about the other tools
  rt::Percentiles others_age_ms;        ///< of their positions on arrival
  link::OtherTools others;              ///< the newest
};

/// Everything that a run reports, in the order in which it becomes known.
// JSON moves without throwing, by functions that could.
// NOLINTNEXTLINE(bugprone-exception-escape)
struct RunSummary {
  std::string device;
  std::string device_profile;
  std::string scene;
  std::string method;
  std::string passivity;  ///< control, observe or coupling
  double rate_requested_Hz = 0.0;
  double elapsed_s = 0.0;  ///< from the first to the last cycle
  RunEnd end = RunEnd::kTime;
  std::string signal_name;  ///< of the signal that ended or shortened it; empty: none
  int exit_status = 0;
  servo::ServoOutcome outcome;
  std::vector<RecoveredFault> recovered;  ///< faults after which the device was reconnected
  int recalibrations = 0;                 ///< reconnections that needed a calibration
  driver::DeviceStatistics device_statistics;
  link::LinkStatistics link;
  std::uint64_t samples_received = 0;  ///< among what the link accepted
  link::ClockEstimate simulator_clock;
  std::uint64_t samples_not_converged = 0;
  double worst_relative_residual = 0.0;
  double worst_solve_time_s = 0.0;
  std::uint64_t records_lost = 0;
  std::uint64_t cycles_kept = 0;
  std::uint64_t samples_overrun = 0;    ///< accepted, but the servo's ring was full
  std::vector<std::string> candidates;  ///< of the rendered method, see ForceMethod::candidates()
  std::map<std::string, std::uint64_t> counters;  ///< of the rendered method, by name
  std::vector<std::string> notes;                 ///< degradations, one sentence each
  std::optional<nlohmann::json> emulator;         ///< its own report
  std::optional<nlohmann::json> simulator;        ///< its own report
  std::map<std::string, MethodError> errors;
  std::optional<double> force_rms_N;  ///< of |F_o|; nothing: no reference forces
  std::optional<double> force_max_N;
  std::string reference;  ///< "computed", or why it was not
  std::optional<nlohmann::json> reference_details;
  /// From the start of a cycle to the page's report that it has drawn it; nothing: no page did.
  struct PictureDelay {
    std::uint64_t pictures = 0;
    double p50_ms = 0.0;
    double p99_ms = 0.0;
  };
  std::optional<PictureDelay> picture_delay;
  /// What a person has changed in the live view, see ViewControls::changes(); null: no view.
  nlohmann::json setting_changes;
  std::vector<std::string> files;
  std::optional<SeveralTools> shared;  ///< nothing: the only tool
};

}  // namespace forcegrid::cli
