// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_summary_json.h"

#include "cli/run/run_summary_numbers.h"

namespace forcegrid::cli {
namespace {

using nlohmann::json;

json first_touches_json(const servo::FirstTouch::Counts& touches) {
  return {{"patches", touches.patches},
          {"seen", touches.touches},
          {"felt", touches.felt},
          {"answered", touches.answered},
          {"denied", touches.denied},
          {"left", touches.left},
          {"unseen", touches.unseen},
          {"wait_mean_ms", mean_wait_ms(touches)},
          {"wait_max_ms", 1e3 * touches.wait_max_s}};
}

json percentiles_json(const rt::Percentiles& p) {
  return {{"p50", p.at(0.5)}, {"p99", p.at(0.99)}, {"p999", p.at(0.999)},
          {"max", p.max()},   {"mean", p.mean()},  {"count", p.count()}};
}

json number_or_null(const std::optional<double>& number) { return number ? json(*number) : json(); }

// A fault that ended the run; empty when it ended as asked.
json faults_json(const servo::ServoOutcome& outcome) {
  json faults = json::array();
  if (outcome.fault != servo::Fault::kNone) {
    faults.push_back({{"name", servo::name_of(outcome.fault)},
                      {"sentence", servo::sentence_for(outcome.fault, outcome.joint)},
                      {"device", outcome.device_failure}});
  }
  return faults;
}

json recovered_json(const RunSummary& summary) {
  json recovered = json::array();
  for (const RecoveredFault& fault : summary.recovered) {
    recovered.push_back({{"name", servo::name_of(fault.fault)}, {"device", fault.device_failure}});
  }
  return recovered;
}

json shared_json(const SeveralTools& shared, const servo::ServoOutcome& outcome) {
  json newest = json::array();
  for (std::size_t k = 0; k < shared.others.count; ++k) {
    const link::OtherTool& other = shared.others.tools[k];
    newest.push_back({{"tool", other.tool},
                      {"in_contact", other.in_contact},
                      {"age_ms", 1e-6 * static_cast<double>(other.age_ns)},
                      {"position_W_m", other.position_W_m}});
  }
  return {{"tool_number", shared.tool_number},
          {"unit",
           {{"manufacturer", shared.manufacturer},
            {"product", shared.product},
            {"serial", shared.serial},
            {"url", shared.url}}},
          {"offset_W_mm", shared.offset_W_mm},
          {"tool_touch",
           {{"stiffness_N_per_m", shared.tool_stiffness_N_per_m},
            {"cycles", outcome.cycles_touching_tools},
            {"largest_force_N", outcome.largest_tool_force_N}}},
          {"other_tools",
           {{"messages", shared.others_told},
            {"age_ms", percentiles_json(shared.others_age_ms)},
            {"newest", newest}}}};
}

void add_run(json& result, const RunSummary& summary) {
  result["device"] = summary.device;
  result["profile"] = summary.device_profile;
  result["scene"] = summary.scene;
  result["method"] = summary.method;
  result["elapsed_s"] = summary.elapsed_s;
  result["ended_by"] = name_of(summary.end, summary.signal_name);
  result["exit_status"] = summary.exit_status;
  result["records_lost"] = summary.records_lost;
  result["cycles_kept"] = summary.cycles_kept;
  result["faults"] = faults_json(summary.outcome);
  result["recovered_faults"] = recovered_json(summary);
  result["reconnects"] = summary.recovered.size();
  result["recalibrations"] = summary.recalibrations;
  result["notes"] = summary.notes;
  result["files"] = summary.files;
  result["emulator"] = summary.emulator.value_or(json());
  result["simulator"] = summary.simulator.value_or(json());
}

void add_loop(json& result, const RunSummary& summary,
              const servo::TelemetryStatistics& statistics) {
  const servo::ServoOutcome& outcome = summary.outcome;
  result["servo_rate_Hz"] = measured_rate_Hz(summary);
  result["servo_rate_requested_Hz"] = summary.rate_requested_Hz;
  result["cycles"] = outcome.cycles;
  result["missed_deadlines"] = outcome.missed_deadlines;
  result["stalls"] = outcome.stalls;
  result["realtime_scheduling"] = outcome.scheduling.realtime;
  result["realtime_reason"] = outcome.scheduling.reason;
  result["memory_locked"] = outcome.memory_lock_refused.empty();
  result["period_us"] = percentiles_json(statistics.period_us);
  result["wakeup_us"] = percentiles_json(statistics.wakeup_us);
  result["compute_us"] = percentiles_json(statistics.compute_us);
  result["cycles_limited"] = statistics.cycles_limited;
  result["motor_warmth"] = statistics.motor_warmth;
  result["cycles_warm"] = statistics.cycles_warm;
  result["emergency_stop"] = servo::name_of(outcome.emergency);
  result["suspected_stuck_encoders"] = outcome.suspected_stuck_encoders;
  result["passivity"] = {{"mode", summary.passivity},
                         {"energy_to_hand_mJ", 1e3 * outcome.energy_to_hand_J},
                         {"largest_energy_to_hand_mJ", 1e3 * outcome.largest_energy_to_hand_J},
                         {"damped_energy_mJ", 1e3 * outcome.damped_energy_J},
                         {"cycles_damped", outcome.cycles_damped},
                         {"cycles_shortened", outcome.cycles_shortened}};
}

// A device without a wrist keeps the axes of W, and has_orientation says so.
json orientation_json(const servo::OrientationStatistics& orientation) {
  json suspected = json::array();
  for (int i = 0; i < 3; ++i) {
    if ((orientation.suspected_encoders & (1U << i)) != 0) {
      suspected.push_back(std::string(1, static_cast<char>('d' + i)));
    }
  }
  return {{"has_orientation", orientation.known},
          {"final_WT_wxyz", orientation.last_WT_wxyz},
          {"largest_speed_rad_per_s", orientation.largest_speed_rad_per_s},
          {"largest_torque_mNm", 1e3 * orientation.largest_torque_Nm},
          {"suspected_encoders", suspected},
          {"cycles_suspected", orientation.cycles_suspected},
          {"button_presses", orientation.button_presses}};
}

void add_device(json& result, const RunSummary& summary,
                const servo::TelemetryStatistics& statistics) {
  const driver::DeviceStatistics& device = summary.device_statistics;
  result["report_age_us"] = percentiles_json(statistics.report_age_us);
  result["reports_received"] = device.reports_received;
  result["reports_discarded"] = device.reports_discarded;
  result["reports_drained"] = device.reports_drained;
  result["reports_lost"] = device.reports_lost;
  result["reports_rejected"] = device.reports_rejected;
  result["reports_late"] = device.reports_late;
  result["reports_unasked"] = device.reports_unasked;
  result["commands_sent"] = device.commands_sent;
  result["commands_clamped"] = device.commands_clamped;
  result["commands_starved"] = device.commands_starved;
  result["kicks"] = device.kicks;
  result["refreshes"] = device.refreshes;
  result["orientation"] = orientation_json(statistics.orientation);
  result["zero_current_delivered"] = summary.outcome.zero_current_delivered;
}

void add_samples(json& result, const RunSummary& summary,
                 const servo::TelemetryStatistics& statistics) {
  const servo::ServoOutcome& outcome = summary.outcome;
  const auto reasons = link::drop_reasons(summary.link);
  result["requests_made"] = outcome.requests_made;
  result["answers_taken"] = outcome.answers_taken;
  result["samples_refused"] = outcome.samples_refused;
  result["first_touches"] = first_touches_json(outcome.first_touches);
  result["sample_age_ms"] = percentiles_json(statistics.sample_age_ms);
  result["samples_received"] = summary.samples_received;
  result["samples_rejected"] = summary.link.dropped();
  result["samples_lost"] = summary.link.lost;
  result["samples_overrun"] = summary.samples_overrun;
  result["samples_taken"] = statistics.samples_taken;
  result["samples_not_converged"] = summary.samples_not_converged;
  result["worst_relative_residual"] = summary.worst_relative_residual;
  result["worst_solve_time_s"] = summary.worst_solve_time_s;
  result["link"] = {{"datagrams_dropped", json::object_t(reasons.begin(), reasons.end())},
                    {"datagrams_overrun", summary.link.overrun},
                    {"clock_known", summary.simulator_clock.known},
                    {"clock_offset_s", summary.simulator_clock.offset_s},
                    {"round_trip_s", summary.simulator_clock.round_trip_s}};
}

// What was rendered: how much of it was known, by which candidate, from which rung of the ladder.
void add_force(json& result, const RunSummary& summary,
               const servo::TelemetryStatistics& statistics) {
  result["rendered_status_cycles"] = json::object();
  for (std::size_t i = 0; i < statistics.rendered_status.size(); ++i) {
    result["rendered_status_cycles"][to_string(static_cast<EstimateStatus>(i))] =
        statistics.rendered_status[i];
  }
  result["grid"] = {{"fills_cut_short", counter(summary, "fills_cut_short")},
                    {"samples_over_threshold", counter(summary, "samples_over_threshold")},
                    {"samples_outside", counter(summary, "samples_outside")}};
  result["counters"] = summary.counters;
  result["candidate_cycles"] = json::object();
  for (std::size_t i = 0; i < summary.candidates.size(); ++i) {
    result["candidate_cycles"][summary.candidates[i]] = statistics.rendered_candidate[i];
  }
  result["candidate_changes"] = statistics.candidate_changes;
  result["first_candidate_changes"] = json::array();
  for (const servo::CandidateChange& change : statistics.first_changes) {
    result["first_candidate_changes"].push_back({{"time_s", change.time_s},
                                                 {"from", summary.candidates.at(change.from)},
                                                 {"to", summary.candidates.at(change.to)},
                                                 {"reason", to_string(change.reason)}});
  }
  result["rung_cycles"] = json::object();
  for (int i = 0; i < servo::kRungs; ++i) {
    result["rung_cycles"][servo::to_string(static_cast<servo::Rung>(i))] =
        statistics.rung_cycles[static_cast<std::size_t>(i)];
  }
  result["rung_changes"] = statistics.rung_changes;
  result["first_rung_changes"] = json::array();
  for (const servo::RungChange& change : statistics.first_rung_changes) {
    result["first_rung_changes"].push_back(
        {{"time_s", change.time_s},
         {"from", servo::to_string(change.from)},
         {"to", servo::to_string(change.to)},
         {"sentence", servo::sentence_for(change.to, change.held_back)}});
  }
  result["uncertainty_mN"] = percentiles_json(statistics.uncertainty_mN);
}

void add_errors(json& result, const RunSummary& summary) {
  json rms = json::object();
  json details = json::object();
  for (const auto& [name, error] : summary.errors) {
    rms[name] = error.rms_percent;
    details[name] = {{"rms_error_percent", error.rms_percent},
                     {"rms_error_percent_first_1s", error.rms_percent_first_1s},
                     {"rms_error_percent_after_1s", error.rms_percent_after_1s},
                     {"max_error_percent_after_1s", error.max_percent_after_1s}};
  }
  result["rms_error_percent"] = rms;
  result["errors"] = details;
  result["force_rms_N"] = number_or_null(summary.force_rms_N);
  result["force_max_N"] = number_or_null(summary.force_max_N);
  result["reference"] = summary.reference;
  result["reference_details"] = summary.reference_details.value_or(json());
}

// Keys that were renamed in 0.2.0, under their old spelling for programs that still read it.
void add_deprecated(json& result) {
  constexpr struct {
    const char* old_key;
    const char* key;
  } kRenamed[] = {{"truth", "reference"},
                  {"truth_details", "reference_details"},
                  {"encoder_doubts", "suspected_stuck_encoders"},
                  {"member_cycles", "candidate_cycles"},
                  {"member_changes", "candidate_changes"},
                  {"first_member_changes", "first_candidate_changes"}};
  for (const auto& [old_key, key] : kRenamed) {
    result[old_key] = result.at(key);
  }
}

}  // namespace

nlohmann::json to_json(const RunSummary& summary, const servo::TelemetryStatistics& statistics) {
  json result = json::object();
  add_run(result, summary);
  add_loop(result, summary, statistics);
  add_device(result, summary, statistics);
  add_samples(result, summary, statistics);
  add_force(result, summary, statistics);
  add_errors(result, summary);
  if (summary.picture_delay) {
    result["picture_delay_ms"] = {{"pictures", summary.picture_delay->pictures},
                                  {"p50", summary.picture_delay->p50_ms},
                                  {"p99", summary.picture_delay->p99_ms}};
  }
  if (summary.shared) {
    result["several_tools"] = shared_json(*summary.shared, summary.outcome);
  }
  result["setting_changes"] = summary.setting_changes;
  add_deprecated(result);
  return result;
}

}  // namespace forcegrid::cli
