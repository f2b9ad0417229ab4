// SPDX-License-Identifier: Apache-2.0
#include "device_session/motor_timing.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <utility>

#include "device_session/device_session.h"

namespace forcegrid::session {
namespace {

servo::TelemetryOptions statistics_alone(double rate_Hz) {
  servo::TelemetryOptions options;
  options.rate_Hz = rate_Hz;
  options.keep_cycles = 0;
  return options;
}

void write_times(std::ofstream& file, const char* name, const rt::Percentiles& times_us) {
  file << ",\n  \"" << name << "\": {\"p10\": " << times_us.at(0.1)
       << ", \"p50\": " << times_us.at(0.5) << ", \"p99\": " << times_us.at(0.99)
       << ", \"p999\": " << times_us.at(0.999) << ", \"max\": " << times_us.max() << "}";
}

}  // namespace

MotorTiming::MotorTiming(servo::ServoPorts& ports, double rate_Hz, std::string file)
    : file_(std::move(file)), telemetry_(ports, statistics_alone(rate_Hz)) {
  if (!std::ofstream(file_)) {
    throw SessionError(SessionError::Reason::kUnusable,
                       "file of the motor thread's times '" + file_ + "': " + std::strerror(errno) +
                           "; name another in FORCEGRID_TIMING, or none");
  }
  telemetry_.start();
}

std::string MotorTiming::finish(bool realtime) {
  telemetry_.stop();
  const servo::TelemetryStatistics& times = telemetry_.statistics();
  std::ofstream file(file_);
  file << "{\n  \"cycles\": " << times.cycles
       << ",\n  \"missed_deadlines\": " << times.missed_deadlines
       << ",\n  \"realtime\": " << (realtime ? "true" : "false");
  write_times(file, "wakeup_us", times.wakeup_us);
  write_times(file, "period_us", times.period_us);
  write_times(file, "compute_us", times.compute_us);
  write_times(file, "report_age_us", times.report_age_us);
  file << "\n}\n";
  file.close();
  return file ? "" : "'" + file_ + "' could not be written: " + std::strerror(errno);
}

}  // namespace forcegrid::session
