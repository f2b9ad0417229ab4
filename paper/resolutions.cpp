// SPDX-License-Identifier: Apache-2.0
#include "paper/resolutions.h"

#include <cmath>
#include <cstdio>

namespace forcegrid::paper {
namespace {

constexpr double kExtent_m[] = {0.16, 0.12, 0.12};

ResolutionRow row_of(const RecordedMotion& motion, int vertices, double of_workspace) {
  ResolutionRow row;
  row.motion = motion.motion;
  row.vertices = vertices;
  row.radius_of_workspace = of_workspace;
  row.radius_m = of_workspace * kExtent_m[0];
  row.radius_over_travel = row.radius_m / motion.longest_travel_m;
  const double spacing_m = std::cbrt(kExtent_m[0] * kExtent_m[1] * kExtent_m[2]) / (vertices - 1);
  row.spacing_over_radius = spacing_m / row.radius_m;
  char text[64];
  std::snprintf(text, sizeof text, "forcegrid cells=%d r=%.6fmm", vertices - 1, 1e3 * row.radius_m);
  const evaluation::Verdict verdict = play(text, motion.trace).verdict;
  row.rms_error_percent = verdict.rms_error_percent_after_1s;
  const std::size_t unknown =
      verdict.cycles_by_status[static_cast<std::size_t>(EstimateStatus::kUnknown)];
  row.unknown_percent =
      100.0 * static_cast<double>(unknown) / static_cast<double>(motion.trace.servo.size());
  row.fill_us = verdict.sample_us_median;
  row.memory_MB = 1e-6 * static_cast<double>(verdict.memory_bytes);
  return row;
}

}  // namespace

std::vector<ResolutionRow> sweep_resolutions(const std::vector<const RecordedMotion*>& motions,
                                             const PaperOptions& options) {
  std::vector<ResolutionRow> rows;
  for (const RecordedMotion* motion : motions) {
    for (const int vertices : options.plan.vertices) {
      for (const double of_workspace : options.plan.radii_of_workspace) {
        check_stop(options);
        rows.push_back(row_of(*motion, vertices, of_workspace));
      }
    }
  }
  return rows;
}

}  // namespace forcegrid::paper
