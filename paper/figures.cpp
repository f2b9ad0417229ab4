// SPDX-License-Identifier: Apache-2.0
#include "paper/figures.h"

#include <algorithm>
#include <string>

namespace forcegrid::paper {
namespace {

constexpr std::size_t kParts = 5;

}  // namespace

const std::vector<std::string>& figure_methods() {
  static const std::vector<std::string> methods{"hold", "forcegrid", "forcegrid unit=m", "auto"};
  return methods;
}

std::vector<Fifth> fifths_of(const evaluation::Trace& trace, const std::vector<Played>& played) {
  const double duration_s = trace.servo.back().time_s + 1.0 / kServoRate_Hz;
  std::vector<Fifth> fifths;
  for (std::size_t part = 0; part < kParts; ++part) {
    Fifth fifth;
    fifth.begin_s = duration_s * static_cast<double>(part) / kParts;
    fifth.end_s = duration_s * static_cast<double>(part + 1) / kParts;
    for (std::size_t i = 1; i < trace.servo.size(); ++i) {
      if (trace.servo[i].time_s >= fifth.begin_s && trace.servo[i].time_s < fifth.end_s) {
        const double way_m = (trace.servo[i].position_W - trace.servo[i - 1].position_W).norm();
        fifth.top_speed_m_per_s = std::max(fifth.top_speed_m_per_s, kServoRate_Hz * way_m);
      }
    }
    for (const Played& each : played) {
      fifth.rms_error_percent.push_back(rms_error_percent(
          trace, each.verdict.forces_W, fifth.begin_s, fifth.end_s, each.verdict.reference_rms_N));
    }
    fifths.push_back(std::move(fifth));
  }
  return fifths;
}

Figures make_figures(const PaperOptions& options) {
  Figures figures;
  figures.motion = record_motion(options.plan.scene, options.plan.motions.at(0), options);
  const evaluation::Trace& trace = figures.motion.trace;
  for (const std::string& method : figure_methods()) {
    check_stop(options);
    figures.played.push_back(play(method, trace));
  }
  figures.fifths = fifths_of(trace, figures.played);
  figures.blind_s = trace.samples.at(1).delivered_s;
  for (const evaluation::ServoInstant& instant : trace.servo) {
    if (instant.time_s < figures.blind_s) {
      figures.unfelt_N = std::max(figures.unfelt_N, instant.force_W.norm());
    }
  }
  return figures;
}

}  // namespace forcegrid::paper
