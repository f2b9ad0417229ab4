// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "evaluation/traces/trace.h"
#include "tools/tuning.h"

namespace forcegrid::cli {

/// Options that all runs of `forcegrid tune` share; as in RunOptions.
struct TuneRuns {
  std::string device, profile, scene, motion, hand;
  bool calibrated = false;  ///< the encoder counters are already valid
  std::string folder;       ///< for the runs' files; each run replaces those of the previous one
};

/// Runs the loop for `seconds` [s] with the default method and records positions, samples and
/// reference forces.
/// @throws std::runtime_error with the reason if the run produced no recording.
evaluation::Trace record_path(const TuneRuns& runs, double rate_Hz, double seconds);

/// Runs the loop for `seconds` [s] with the settings of `row`, and fills in the measured values or
/// the problem.
void measure_in_loop(const TuneRuns& runs, double seconds, tools::TuningRow& row);

}  // namespace forcegrid::cli
