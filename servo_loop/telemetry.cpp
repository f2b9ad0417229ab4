// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/telemetry.h"

#include <algorithm>
#include <cerrno>
#include <cinttypes>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iomanip>
#include <stdexcept>
#include <utility>

#include "rt/exception_text.h"

namespace forcegrid::servo {
namespace {

constexpr std::int64_t kLine_ns = 1'000'000'000;
constexpr double kPauseShare = 0.125;  // of a period, from the end of a cycle to a drain

}  // namespace

Telemetry::Telemetry(ServoPorts& ports, TelemetryOptions options)
    : ports_(ports), options_(std::move(options)) {}

Telemetry::~Telemetry() { stop(); }

void Telemetry::start() {
  thread_ = std::thread([this] {
    rt::name_current_thread("telemetry");
    while (!stop_.load(std::memory_order_acquire)) {
      drain_or_give_up();
      std::this_thread::sleep_until(next_drain(rt::Clock::now(),
                                               records_.empty() ? nullptr : &records_.back(),
                                               options_.drain_interval, options_.rate_Hz));
    }
    drain_or_give_up();
  });
}

void Telemetry::stop() {
  stop_.store(true, std::memory_order_release);
  if (thread_.joinable()) {
    thread_.join();
  }
}

// An exception that left this thread would end the program before the loop could write zero
// current. So what is shown or recorded ends here, and the loop goes on.
void Telemetry::drain_or_give_up() noexcept {
  for (int attempt = 0; attempt < 2; ++attempt) {  // the second is without callbacks
    try {
      drain();
      return;
    } catch (...) {
      if (!trouble_) {
        trouble_ = std::current_exception();
      }
      options_.on_cycle = nullptr;
      options_.on_drained = nullptr;
      options_.on_sentence = nullptr;
      options_.on_live_line = nullptr;
    }
  }
}

rt::Clock::time_point Telemetry::next_drain(rt::Clock::time_point now, const CycleRecord* newest,
                                            std::chrono::milliseconds interval, double rate_Hz) {
  const rt::Clock::time_point earliest = now + interval;
  if (newest == nullptr) {
    return earliest;
  }
  const double period_ns = 1e9 / rate_Hz;
  const double end_ns = static_cast<double>(newest->time_ns) + 1e3 * newest->compute_us;
  const double pause_ns = end_ns + kPauseShare * period_ns;
  const double wait_ns = static_cast<double>(earliest.time_since_epoch().count()) - pause_ns;
  const double more_ns = std::ceil(wait_ns / period_ns) * period_ns - wait_ns;
  return earliest + std::chrono::nanoseconds(std::llround(more_ns));
}

std::string Telemetry::trouble() const { return rt::text_of(trouble_); }

void Telemetry::drain() {
  CycleRecord record;
  bool any = false;
  while (ports_.records.pop(record)) {
    any = true;
    if (statistics_.cycles == 0) {
      first_time_ns_ = record.time_ns;
      last_line_ns_ = record.time_ns;
    } else {
      statistics_.period_us.add(record.period_us);
    }
    ++statistics_.cycles;
    statistics_.wakeup_us.add(record.wakeup_us);
    statistics_.compute_us.add(record.compute_us);
    statistics_.report_age_us.add(record.report_age_us);
    if (record.sample_age_ms >= 0.0) {
      statistics_.sample_age_ms.add(record.sample_age_ms);
    }
    statistics_.cycles_limited += record.limits_acted != 0 ? 1 : 0;
    statistics_.missed_deadlines += record.missed_deadlines;
    statistics_.samples_taken = record.samples_taken;
    damped_since_line_ = damped_since_line_ || record.passivity_damping_N_s_per_m > 0.0;
    shortened_since_line_ = shortened_since_line_ || record.passivity_scale < 1.0;
    take_rung(record);
    take_warmth(record);
    take_orientation(record);
    take_rendered(record);
    records_.push_back(record);
    if (records_.size() > options_.keep_cycles) {
      records_.pop_front();
    }
    if (options_.on_cycle) {
      options_.on_cycle(record);
    }
    if (options_.on_live_line && record.time_ns >= last_line_ns_ + kLine_ns) {
      say_live_line(record);
      // On the second where the loop was on time; from here on after a pause.
      const bool late = record.time_ns >= last_line_ns_ + 2 * kLine_ns;
      last_line_ns_ = late ? record.time_ns : last_line_ns_ + kLine_ns;
    }
  }
  if (any && options_.on_drained) {
    options_.on_drained();
  }
}

void Telemetry::take_rung(const CycleRecord& record) {
  ++statistics_.rung_cycles[static_cast<std::size_t>(record.rung)];
  if (record.rung == last_rung_) {
    return;
  }
  const double time_s = 1e-9 * static_cast<double>(record.time_ns - first_time_ns_);
  ++statistics_.rung_changes;
  if (statistics_.first_rung_changes.size() < kChangesKept) {
    statistics_.first_rung_changes.push_back({time_s, last_rung_, record.rung, record.held_back});
  }
  // Late samples come and go on a poor network; what they change is small, and in the summary.
  const auto rendered = [](Rung rung) { return rung == Rung::kFresh || rung == Rung::kOld; };
  if (!(rendered(record.rung) && rendered(last_rung_))) {
    say(record, sentence_for(record.rung, record.held_back));
  }
  last_rung_ = record.rung;
}

void Telemetry::take_warmth(const CycleRecord& record) {
  statistics_.motor_warmth = std::max(statistics_.motor_warmth, record.motor_warmth);
  if ((record.limits_acted & driver::kLimitWarm) == 0) {
    said_warm_ = said_warm_ && record.motor_warmth > MotorWarmth::kFull;
    return;
  }
  ++statistics_.cycles_warm;
  if (!said_warm_) {
    say(record,
        "A motor is warm: its current is limited toward what it bears for ever; let go, or press "
        "less, and it cools in a minute.");
  }
  said_warm_ = true;
}

void Telemetry::take_orientation(const CycleRecord& record) {
  OrientationStatistics& seen = statistics_.orientation;
  seen.button_presses += (record.buttons & ~last_buttons_) != 0 ? 1 : 0;
  last_buttons_ = record.buttons;
  if (!record.has_orientation || record.fault != Fault::kNone) {
    return;
  }
  seen.known = true;
  seen.last_WT_wxyz = record.orientation_WT_wxyz;
  const Triple& w = record.angular_velocity_W_rad_per_s;
  seen.largest_speed_rad_per_s =
      std::max(seen.largest_speed_rad_per_s, std::hypot(w[0], w[1], w[2]));
  const Triple& torque = record.tool_torque_W_Nm;
  seen.largest_torque_Nm =
      std::max(seen.largest_torque_Nm, std::hypot(torque[0], torque[1], torque[2]));
  seen.cycles_suspected += record.suspected_wrist_encoders != 0 ? 1 : 0;
  for (int i = 0; i < 3; ++i) {
    const auto bit = static_cast<std::uint8_t>(1U << i);
    if ((record.suspected_wrist_encoders & bit) != 0 && (seen.suspected_encoders & bit) == 0) {
      say(record, std::string("Encoder ") + static_cast<char>('d' + i) +
                      " of the wrist has not counted while the tool moved 1 m: the orientation may "
                      "be wrong. Check its cable, or use a profile without [gimbal].");
    }
  }
  seen.suspected_encoders |= record.suspected_wrist_encoders;
}

void Telemetry::say(const CycleRecord& record, const std::string& sentence) {
  char time[24];
  std::snprintf(time, sizeof time, "%7.1f s  ",
                1e-9 * static_cast<double>(record.time_ns - first_time_ns_));
  if (options_.on_sentence) {
    options_.on_sentence(time + sentence);
  }
}

void Telemetry::take_rendered(const CycleRecord& record) {
  if (record.rendered_candidate != last_candidate_) {
    ++statistics_.candidate_changes;
    if (statistics_.first_changes.size() < kChangesKept) {
      statistics_.first_changes.push_back(
          {1e-9 * static_cast<double>(record.time_ns - first_time_ns_), last_candidate_,
           record.rendered_candidate, record.rendered_reason});
    }
    last_candidate_ = record.rendered_candidate;
  }
  if (!record.in_contact) {
    return;
  }
  ++statistics_.rendered_status[static_cast<std::size_t>(record.method_status[0])];
  ++statistics_
        .rendered_candidate[std::min<std::size_t>(record.rendered_candidate, kMaxCandidates - 1)];
  if (std::isfinite(record.method_uncertainty_N[0])) {
    statistics_.uncertainty_mN.add(1e3 * record.method_uncertainty_N[0]);
  }
}

void Telemetry::say_live_line(const CycleRecord& record) {
  const double elapsed_s = 1e-9 * static_cast<double>(record.time_ns - first_time_ns_);
  const double since_s = 1e-9 * static_cast<double>(record.time_ns - last_line_ns_);
  const Triple& p = record.position_W_m;
  const Triple& f = record.commanded_force_D_N;
  char line[512];
  std::snprintf(line, sizeof line,
                "%5.0f s  tool (%+6.1f %+6.1f %+6.1f) mm  %-10s force (%+5.2f %+5.2f %+5.2f) N  "
                "%4.0f cycles/s  report %3.1f ms  sample %3.0f ms old  missed %" PRIu64
                "  %s  energy %+.2f mJ%s",
                elapsed_s, 1e3 * p[0], 1e3 * p[1], 1e3 * p[2],
                record.in_contact ? "in contact" : "free", f[0], f[1], f[2],
                static_cast<double>(statistics_.cycles - cycles_at_last_line_) / since_s,
                1e-3 * record.report_age_us, record.sample_age_ms, statistics_.missed_deadlines,
                to_string(record.rung), 1e3 * record.energy_to_hand_J, guard_text());
  options_.on_live_line(line + clock_text());
  cycles_at_last_line_ = statistics_.cycles;
  damped_since_line_ = shortened_since_line_ = false;
}

// How far away the simulator is and how its clock differs, on a link that can tell.
std::string Telemetry::clock_text() {
  link::ClockEstimate clock;
  if (!ports_.simulator_clock.fetch(clock)) {
    return {};
  }
  char text[80];
  std::snprintf(text, sizeof text, "  round trip %.1f ms, simulator's clock %+.4f s",
                1e3 * clock.round_trip_s, clock.offset_s);
  return text;
}

// What the passivity guard has done since the last line.
const char* Telemetry::guard_text() const noexcept {
  return shortened_since_line_ ? "  SHORTENED to stay passive"
                               : (damped_since_line_ ? "  damped to stay passive" : "");
}

void Telemetry::write_flight_record(const std::string& path, double seconds,
                                    std::int64_t end_ns) const {
  errno = 0;
  std::ofstream file(path);
  file << "time_s,cycle,period_us,compute_us,report_age_us,report_sequence,count_a,count_b,count_c,"
          "x_W_m,y_W_m,z_W_m,vx_W_m_per_s,vy_W_m_per_s,vz_W_m_per_s,gain,damping_gain,rung,fx_D_N,"
          "fy_D_N,fz_D_N,"
          "current_a_A,current_b_A,current_c_A,limits_acted,motor_warmth,"
          "energy_to_hand_J,passivity_damping_N_s_per_m,passivity_scale,in_contact,contact_epoch,"
          "samples_taken,"
          "sample_age_ms,missed_deadlines,fault,rendered_member,rendered_reason,buttons,count_d,"
          "count_e,count_f,qw_WT,qx_WT,qy_WT,qz_WT,suspected_wrist_encoders";
  for (const std::string& name : options_.method_names) {
    file << ',' << name << "_x_N," << name << "_y_N," << name << "_z_N," << name << "_status,"
         << name << "_uncertainty_N";
  }
  file << '\n' << std::setprecision(9);
  const std::int64_t newest_ns = records_.empty() ? 0 : records_.back().time_ns;
  const std::int64_t last_ns = std::min(end_ns, newest_ns);
  for (const CycleRecord& r : records_) {
    if (r.time_ns > last_ns || last_ns - r.time_ns > static_cast<std::int64_t>(1e9 * seconds)) {
      continue;
    }
    file << 1e-9 * static_cast<double>(r.time_ns - first_time_ns_) << ',' << r.cycle << ','
         << r.period_us << ',' << r.compute_us << ',' << r.report_age_us << ','
         << r.report_sequence;
    for (const std::int32_t count : r.counts) {
      file << ',' << count;
    }
    for (const Triple* t : {&r.position_W_m, &r.velocity_W_m_per_s}) {
      file << ',' << (*t)[0] << ',' << (*t)[1] << ',' << (*t)[2];
    }
    file << ',' << r.gain << ',' << r.damping_gain << ',' << to_string(r.rung);
    for (const Triple* t : {&r.commanded_force_D_N, &r.current_A}) {
      file << ',' << (*t)[0] << ',' << (*t)[1] << ',' << (*t)[2];
    }
    file << ',' << static_cast<int>(r.limits_acted) << ',' << r.motor_warmth << ','
         << r.energy_to_hand_J << ',' << r.passivity_damping_N_s_per_m << ',' << r.passivity_scale
         << ',' << r.in_contact << ',' << r.contact_epoch << ',' << r.samples_taken << ','
         << r.sample_age_ms << ',' << r.missed_deadlines << ',' << name_of(r.fault) << ','
         << static_cast<int>(r.rendered_candidate) << ',' << to_string(r.rendered_reason) << ','
         << static_cast<int>(r.buttons);
    for (const std::int32_t count : r.gimbal_counts) {
      file << ',' << count;
    }
    for (const double part : r.orientation_WT_wxyz) {
      file << ',' << part;
    }
    file << ',' << static_cast<int>(r.suspected_wrist_encoders);
    for (std::size_t i = 0; i < options_.method_names.size(); ++i) {
      const Triple& f = r.method_force_W_N[i];
      file << ',' << f[0] << ',' << f[1] << ',' << f[2] << ',' << to_string(r.method_status[i])
           << ',' << r.method_uncertainty_N[i];
    }
    file << '\n';
  }
  file.close();
  if (!file) {
    throw std::runtime_error("flight record " + path +
                             " could not be written: " + std::strerror(errno));
  }
}

}  // namespace forcegrid::servo
