// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_summary_text.h"

#include <cinttypes>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "cli/run/run_summary_numbers.h"

namespace forcegrid::cli {
namespace {

__attribute__((format(printf, 2, 3))) void append(std::string& text, const char* format, ...) {
  char line[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  text += line;
}

void append_percentiles(std::string& text, const char* what, const rt::Percentiles& p) {
  append(text, "  %-14s median %8.1f   p99 %8.1f   p99.9 %8.1f   max %8.1f\n", what, p.at(0.5),
         p.at(0.99), p.at(0.999), p.max());
}

// How long each candidate of an ensemble was rendered.
void append_candidates(std::string& text, const RunSummary& summary,
                       const servo::TelemetryStatistics& statistics) {
  std::uint64_t all = 0;
  for (const std::uint64_t cycles : statistics.rendered_candidate) {
    all += cycles;
  }
  if (summary.candidates.empty() || all == 0) {
    return;
  }
  text += summary.method + ", rendered candidates:";
  const char* separator = " ";
  for (std::size_t i = 0; i < summary.candidates.size(); ++i) {
    if (statistics.rendered_candidate[i] > 0) {
      append(
          text, "%s%s %.1f %%", separator, summary.candidates[i].c_str(),
          100.0 * static_cast<double>(statistics.rendered_candidate[i]) / static_cast<double>(all));
      separator = ", ";
    }
  }
  append(text, "; %" PRIu64 " changes; uncertainty of the force %.1f mN (median)\n",
         statistics.candidate_changes, statistics.uncertainty_mN.at(0.5));
}

// Round trip, clock and losses of the link to the simulator.
void append_link(std::string& text, const RunSummary& summary) {
  if (summary.simulator_clock.known) {
    append(text, "Link: quickest round trip %.2f ms; the simulator's clock is %.4f s %s\n",
           1e3 * summary.simulator_clock.round_trip_s, std::abs(summary.simulator_clock.offset_s),
           summary.simulator_clock.offset_s < 0.0 ? "behind" : "ahead");
  }
  if (summary.link.dropped() + summary.link.overrun > 0) {
    text += "Link: datagrams dropped: " + link::drop_text(summary.link);
    append(text, "%s%" PRIu64 " by the system because its buffer was full\n",
           summary.link.dropped() > 0 ? "; " : "", summary.link.overrun);
  }
}

// Share of the cycles on each rung of the ladder.
void append_rungs(std::string& text, const servo::TelemetryStatistics& statistics) {
  if (statistics.cycles == 0) {
    return;
  }
  text += "Force from";
  const char* separator = " ";
  for (int i = 0; i < servo::kRungs; ++i) {
    const auto rung = static_cast<servo::Rung>(i);
    append(text, "%s%s %.1f %%", separator, servo::to_string(rung),
           100.0 * static_cast<double>(statistics.rung_cycles[static_cast<std::size_t>(i)]) /
               static_cast<double>(statistics.cycles));
    separator = ", ";
  }
  append(text, " of the cycles; %" PRIu64 " changes\n", statistics.rung_changes);
}

// Rate, deadlines and scheduling of the loop.
void append_timing(std::string& text, const RunSummary& summary,
                   const servo::TelemetryStatistics& statistics) {
  const servo::ServoOutcome& outcome = summary.outcome;
  append(text,
         "%" PRIu64 " cycles in %.2f s at %.1f Hz (requested %.0f), %" PRIu64
         " missed deadlines, %s%s\n",
         outcome.cycles, summary.elapsed_s, measured_rate_Hz(summary), summary.rate_requested_Hz,
         outcome.missed_deadlines,
         outcome.scheduling.realtime ? "real-time scheduling" : "no real-time scheduling",
         outcome.memory_lock_refused.empty() ? ", memory locked" : ", memory not locked");
  append_percentiles(text, "period / us", statistics.period_us);
  append_percentiles(text, "compute / us", statistics.compute_us);
  append_percentiles(text, "report age / us", statistics.report_age_us);
}

// What the device reported and what was sent to it.
void append_device(std::string& text, const RunSummary& summary) {
  const servo::ServoOutcome& outcome = summary.outcome;
  append(text,
         "Device: %" PRIu64 " reports, %" PRIu64 " stale ones skipped, %" PRIu64 " lost, %" PRIu64
         " late, %" PRIu64 " rejected; %" PRIu64 " commands, %" PRIu64
         " clamped; zero current at the end %s\n",
         summary.device_statistics.reports_received,
         summary.device_statistics.reports_discarded + summary.device_statistics.reports_drained,
         summary.device_statistics.reports_lost, summary.device_statistics.reports_late,
         summary.device_statistics.reports_rejected, summary.device_statistics.commands_sent,
         summary.device_statistics.commands_clamped,
         outcome.zero_current_delivered ? "delivered"
                                        : "could not be delivered: the motors are left to the "
                                          "device's own watchdog");
}

// The wrist of a device that has one.
void append_wrist(std::string& text, const servo::OrientationStatistics& orientation) {
  if (!orientation.known) {
    return;
  }
  const auto& q = orientation.last_WT_wxyz;
  append(text,
         "Wrist: orientation (w, x, y, z) %.4f %+.4f %+.4f %+.4f at the end, turned at %.1f rad/s "
         "at most; %" PRIu64 " presses of a button\n",
         q[0], q[1], q[2], q[3], orientation.largest_speed_rad_per_s, orientation.button_presses);
  if (orientation.cycles_suspected > 0) {
    append(text, "Wrist: in %" PRIu64 " cycles an encoder had not counted for long:",
           orientation.cycles_suspected);
    for (int i = 0; i < 3; ++i) {
      if ((orientation.suspected_encoders & (1U << i)) != 0) {
        append(text, " %c", 'd' + i);
      }
    }
    text += "; check its cable\n";
  }
}

// The simulator's samples.
void append_simulator(std::string& text, const RunSummary& summary) {
  append(text,
         "Simulator: %" PRIu64 " samples taken, %" PRIu64
         " rejected; longest solve %.1f ms, worst "
         "relative residual %.1e, %" PRIu64 " not converged\n",
         summary.samples_received, summary.link.dropped(), 1e3 * summary.worst_solve_time_s,
         summary.worst_relative_residual, summary.samples_not_converged);
}

// Contacts that the loop saw before the simulator answered.
void append_first_touches(std::string& text, const RunSummary& summary) {
  const servo::FirstTouch::Counts& touches = summary.outcome.first_touches;
  if (touches.patches > 0) {
    append(text,
           "First touches: %" PRIu64 " seen by the loop itself, %" PRIu64
           " of them rendered before the answer, %" PRIu64
           " answered by the simulator after %.1f ms on average, %.1f ms at most; %" PRIu64
           " denied, %" PRIu64 " left before; %" PRIu64 " contacts not seen\n",
           touches.touches, touches.felt, touches.answered, mean_wait_ms(touches),
           1e3 * touches.wait_max_s, touches.denied, touches.left, touches.unseen);
  }
}

// Samples that the loop refused, and cycles in which a limit acted.
void append_limits(std::string& text, const RunSummary& summary,
                   const servo::TelemetryStatistics& statistics) {
  const servo::ServoOutcome& outcome = summary.outcome;
  if (outcome.samples_refused > 0) {
    append(text,
           "%" PRIu64 " simulator forces were refused as implausible jumps (docs/safety.md)\n",
           outcome.samples_refused);
  }
  if (statistics.cycles_limited > 0) {
    append(text, "A limit of the profile acted in %" PRIu64 " cycles\n", statistics.cycles_limited);
  }
}

// The energy account of the passivity guard.
void append_energy(std::string& text, const RunSummary& summary) {
  const servo::ServoOutcome& outcome = summary.outcome;
  append(text,
         "Energy given to the hand by the rendered force: %+.2f mJ in all, at most %.3f mJ in a "
         "contact",
         1e3 * outcome.energy_to_hand_J, 1e3 * outcome.largest_energy_to_hand_J);
  if (outcome.cycles_damped + outcome.cycles_shortened > 0) {
    append(text,
           "; to stay passive %" PRIu64 " cycles were damped (%.2f mJ) and %" PRIu64 " shortened",
           outcome.cycles_damped, 1e3 * outcome.damped_energy_J, outcome.cycles_shortened);
  }
  text += "\n";
}

// Warm motors, pauses and lost records.
void append_disturbances(std::string& text, const RunSummary& summary,
                         const servo::TelemetryStatistics& statistics) {
  const servo::ServoOutcome& outcome = summary.outcome;
  if (statistics.cycles_warm > 0) {
    append(text,
           "A motor was warm (%.0f %% of the heat that its continuous current makes) and its "
           "current was reduced in %" PRIu64 " cycles\n",
           100.0 * statistics.motor_warmth, statistics.cycles_warm);
  }
  if (outcome.stalls > 0) {
    append(text, "%" PRIu64 " pauses of more than 50 ms, after which the force ramped in again\n",
           outcome.stalls);
  }
  if (summary.records_lost > 0) {
    append(text, "%" PRIu64 " cycles were not recorded: telemetry could not keep up\n",
           summary.records_lost);
  }
}

// Cycles in which the rendered method knew the force.
void append_knowledge(std::string& text, const RunSummary& summary,
                      const servo::TelemetryStatistics& statistics) {
  const auto& status = statistics.rendered_status;
  const auto count_of = [&](EstimateStatus which) {
    return status[static_cast<std::size_t>(which)];
  };
  const std::uint64_t without = count_of(EstimateStatus::kUnknown) +
                                count_of(EstimateStatus::kOutside) +
                                count_of(EstimateStatus::kNotFinite);
  if (without + count_of(EstimateStatus::kPartlyKnown) > 0) {
    append(text,
           "%s in contact: force known in %" PRIu64 " cycles, partly in %" PRIu64
           ", not in %" PRIu64 " (%" PRIu64 " of these outside the grid)\n",
           summary.method.c_str(), count_of(EstimateStatus::kOk),
           count_of(EstimateStatus::kPartlyKnown), without, count_of(EstimateStatus::kOutside));
  }
}

// How long a method over two tools was rendered, and why not for longer.
void append_both_tools(std::string& text, const RunSummary& summary) {
  const std::uint64_t both = counter(summary, "cycles_both_tools");
  const std::uint64_t off = counter(summary, "cycles_other_off");
  const std::uint64_t late = counter(summary, "cycles_other_late");
  const std::uint64_t learning = counter(summary, "cycles_learning");
  const std::uint64_t all = both + off + late + learning;
  if (all == 0) {
    return;
  }
  const auto percent = [all](std::uint64_t cycles) {
    return 100.0 * static_cast<double>(cycles) / static_cast<double>(all);
  };
  append(text,
         "Over both tools in %.1f %% of the cycles in contact; alone in %.1f %% while the other "
         "tool was off the object, %.1f %% while its place was late, %.1f %% while too little was "
         "known; %" PRIu64 " of %" PRIu64 " samples found the other tool's\n",
         percent(both), percent(off), percent(late), percent(learning),
         counter(summary, "samples_paired"),
         counter(summary, "samples_paired") + counter(summary, "samples_unpaired"));
}

// Counters of the rendered method.
void append_method_counters(std::string& text, const RunSummary& summary) {
  if (summary.samples_overrun > 0) {
    append(text, "%" PRIu64 " samples arrived faster than the servo takes them and were dropped\n",
           summary.samples_overrun);
  }
  const std::uint64_t cut_short = counter(summary, "fills_cut_short");
  const std::uint64_t over_threshold = counter(summary, "samples_over_threshold");
  const std::uint64_t outside = counter(summary, "samples_outside");
  if (cut_short + over_threshold + outside > 0) {
    append(text,
           "Grid: %" PRIu64 " fills cut short (raise --fill-budget), %" PRIu64
           " samples over the threshold s, %" PRIu64 " outside the grid\n",
           cut_short, over_threshold, outside);
  }
  if (const std::uint64_t recycled = counter(summary, "blocks_recycled"); recycled > 0) {
    append(text,
           "Grid: %" PRIu64
           " blocks were emptied to make room for others (use a larger pool=, fewer cells or a "
           "smaller r)\n",
           recycled);
  }
  if (const std::uint64_t unpaid = counter(summary, "samples_over_budget"); unpaid > 0) {
    append(text,
           "Method: %" PRIu64
           " samples were left out because the budget was used up (raise --budget-us)\n",
           unpaid);
  }
  if (const std::uint64_t unusable = counter(summary, "samples_unusable"); unusable > 0) {
    append(text, "Method: %" PRIu64 " samples were unusable (not finite, or without stiffness)\n",
           unusable);
  }
}

// Why the run ended, unless it ended as asked.
void append_fault(std::string& text, const RunSummary& summary) {
  const servo::ServoOutcome& outcome = summary.outcome;
  if (outcome.fault != servo::Fault::kNone) {
    text += fault_text(outcome) + "\n";
  }
}

// What else ended it.
void append_end(std::string& text, const RunSummary& summary) {
  if (summary.end == RunEnd::kSignal) {
    text += "Ended by " + summary.signal_name + "\n";
  } else if (summary.end == RunEnd::kNoSimulator) {
    text += "ENDED WITHOUT A SIMULATOR: there was no force at any time\n";
  } else if (summary.end == RunEnd::kLostSimulator) {
    text += "ENDED WITHOUT A SIMULATOR: it was lost, and the force faded to zero\n";
  }
}

}  // namespace

std::string fault_text(const servo::ServoOutcome& outcome) {
  std::string text =
      outcome.fault == servo::Fault::kEmergencyStop
          ? std::string("EMERGENCY STOP by ") + servo::words_of(outcome.emergency) + ". "
          : std::string("FAULT: ");
  text += servo::sentence_for(outcome.fault, outcome.joint);
  return text + (outcome.device_failure.empty() ? "" : " (" + outcome.device_failure + ")");
}

std::string loop_text(const RunSummary& summary, const servo::TelemetryStatistics& statistics) {
  std::string text = "\n";
  append_timing(text, summary, statistics);
  append_device(text, summary);
  append_wrist(text, statistics.orientation);
  append_simulator(text, summary);
  append_link(text, summary);
  append_first_touches(text, summary);
  append_limits(text, summary, statistics);
  append_rungs(text, statistics);
  append_energy(text, summary);
  append_disturbances(text, summary, statistics);
  append_knowledge(text, summary, statistics);
  append_candidates(text, summary, statistics);
  append_both_tools(text, summary);
  append_method_counters(text, summary);
  for (const std::string& note : summary.notes) {
    text += "Note: " + note + "\n";
  }
  if (!summary.recovered.empty()) {
    append(text, "Reconnected %zu times, %d of them with a new calibration\n",
           summary.recovered.size(), summary.recalibrations);
  }
  append_fault(text, summary);
  append_end(text, summary);
  return text;
}

std::string motors_text(const nlohmann::json& emulator) {
  // A Falcon's amplifiers take commands; no source gives the resulting current.
  const bool has_commands = emulator.contains("final_command");
  const auto motor =
      emulator.at(has_commands ? "final_command" : "final_current_mA").get<std::vector<double>>();
  std::string text;
  append(text, "Emulated motors: final %s %.0f %.0f %.0f%s, %" PRIu64 " watchdog trips\n",
         has_commands ? "command" : "current", motor.at(0), motor.at(1), motor.at(2),
         has_commands ? "" : " mA", emulator.at("watchdog_trips").get<std::uint64_t>());
  if (const auto core = emulator.find("core"); core != emulator.end() && !core->is_null()) {
    append(text,
           "Second processor: %" PRIu64 " cycles, %" PRIu64
           " answered after %.1f ms on average, %.1f ms at most; %" PRIu64 " silences\n",
           core->at("cycles").get<std::uint64_t>(), core->at("answers").get<std::uint64_t>(),
           core->at("mean_latency_ms").get<double>(), core->at("worst_latency_ms").get<double>(),
           core->at("silences").get<std::uint64_t>());
  }
  return text;
}

std::string workers_text(const nlohmann::json& simulator) {
  const nlohmann::json& workers = simulator.at("workers");
  if (workers.at("each").empty()) {
    return "";
  }
  const auto count = [&workers](const char* key) { return workers.at(key).get<std::uint64_t>(); };
  const std::uint64_t replies = simulator.at("replies").get<std::uint64_t>();
  std::string text;
  append(text,
         "Queries: %" PRIu64 " answered; workers were given %" PRIu64 ", answered %" PRIu64
         " in time and %" PRIu64 " too late; of %" PRIu64 " checked answers %" PRIu64
         " were wrong\n",
         replies, count("jobs_given"), count("answers"), count("late"),
         count("checked_right") + count("wrong"), count("wrong"));
  for (const nlohmann::json& worker : workers.at("each")) {
    append(text, "  worker %-24s %6" PRIu64 " answers, %.1f ms each%s%s\n",
           worker.at("name").get<std::string>().c_str(), worker.at("answers").get<std::uint64_t>(),
           worker.at("round_trip_mean_ms").get<double>(),
           worker.at("expelled").get<bool>() ? ", expelled" : "",
           worker.at("present").get<bool>() ? "" : ", gone");
  }
  return text;
}

std::string errors_text(const RunSummary& summary) {
  std::string text;
  if (!summary.errors.empty()) {
    append(text, "Reference force F_o: RMS %.2f N, largest %.2f N\n",
           summary.force_rms_N.value_or(0.0), summary.force_max_N.value_or(0.0));
    append(text,
           "Error against F_o, %% of its RMS:   whole   first 1 s   after 1 s   worst after 1 s\n");
    for (const auto& [name, error] : summary.errors) {
      append(text, "  %-28s %9.2f %11.2f %11.2f %17.2f\n",
             (name == "hold" ? "hold (streaming)" : name).c_str(), error.rms_percent,
             error.rms_percent_first_1s, error.rms_percent_after_1s, error.max_percent_after_1s);
    }
  } else {
    text += "No errors against the reference force: " + summary.reference + "\n";
  }
  for (const std::string& file : summary.files) {
    text += "Wrote " + file + "\n";
  }
  return text;
}

}  // namespace forcegrid::cli
